//! What several tests share: values through the codec and back.

use std::sync::Arc;

use hprm_codec::{DecodeError, Draft, Memory, decode, encode};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The parts as they arrive in the same process.
pub(crate) fn parts(draft: &Draft) -> Vec<Arc<dyn Memory>> {
    draft.parts.iter().map(|part| part.clone().into_memory()).collect()
}

/// The value as a receiver of that type gets it.
pub(crate) fn sent<R: DeserializeOwned>(
    value: &(impl Serialize + ?Sized),
) -> Result<R, DecodeError> {
    let draft = encode(value).unwrap();
    decode(&draft.head, &parts(&draft))
}

/// The head of a value that has no parts.
pub(crate) fn head(value: &(impl Serialize + ?Sized)) -> Vec<u8> {
    let draft = encode(value).unwrap();
    assert!(draft.parts.is_empty());
    draft.head
}

/// What a receiver of that type makes of a head without parts.
pub(crate) fn read<R: DeserializeOwned>(head: &[u8]) -> Result<R, DecodeError> {
    decode(head, &[])
}

/// The text of the error that a receiver of that type gets.
pub(crate) fn refused<R: DeserializeOwned>(head: &[u8]) -> String {
    read::<R>(head).err().expect("the value is refused").to_string()
}
