//! Any reference to an object, and any descriptor, may come from a peer: a reader reads only memory that
//! the owner has sealed, and everything else is an error. Shared with the fuzz target in `fuzz/`.

use std::os::fd::AsFd;

use hprm_core::{FederateId, ObjectRef};
use hprm_store::{Store, StoreLimits};

const A: FederateId = FederateId(0);
const B: FederateId = FederateId(1);

/// The length of the owner's one segment: small, so that there may be many owners.
const CAPACITY: u64 = 64 << 10;

/// The value of each byte that the owner has written.
const MARK: u8 = 0xa5;

/// Bytes that are read as numbers and references.
struct Script<'a>(&'a [u8]);

impl Script<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*first)
    }

    fn number(&mut self) -> u64 {
        // Numbers near limits find more than others.
        let near = [0, 1, 64, 4096, CAPACITY, CAPACITY - 64, 1 << 32, u64::MAX];
        let Some(kind) = self.byte() else { return 0 };
        let offset = u64::from(self.byte().filter(|byte| *byte < 64).unwrap_or(0));
        match kind {
            0..=127 => near[usize::from(kind) % near.len()].wrapping_add(offset),
            128..=191 => near[usize::from(kind) % near.len()].wrapping_sub(offset),
            _ => {
                (0..8).fold(offset, |number, _| (number << 8) | u64::from(self.byte().unwrap_or(0)))
            }
        }
    }

    fn object(&mut self) -> ObjectRef {
        let owner = FederateId(u16::from(self.byte().unwrap_or(0) % 3));
        let (serial, segment) = (self.number(), self.number());
        let segment = u32::try_from(segment).unwrap_or(u32::MAX);
        ObjectRef { owner, serial, segment, offset: self.number(), len: self.number() }
    }
}

/// Calls the stores of a reader and an owner as `bytes` say. Returns how many objects were opened.
pub(crate) fn strange_objects(bytes: &[u8]) -> usize {
    let limits = StoreLimits { capacity_bytes: CAPACITY, ..StoreLimits::default() };
    let [mut a, mut b] = [A, B].map(|me| Store::new(me, limits));
    let genuine = a.put(&[MARK; 5_000], &[A, B]).expect("there is room");
    let mut script = Script(bytes);
    let mut opened = 0;
    while let Some(step) = script.byte() {
        match step % 6 {
            0 => {
                for segment in a.unannounced(B) {
                    let fd = segment.as_fd().try_clone_to_owned().expect("a descriptor is left");
                    // It may be attached already, also with another length.
                    let _ = b.attach(A, segment.segment, segment.len, fd);
                }
            }
            1 => attach_anything(&mut a, &mut b, &mut script),
            2 => opened += usize::from(open(&mut b, script.object())),
            3 => opened += usize::from(open(&mut a, script.object())),
            4 => {
                let serial = script.number();
                let _ = a.release(serial, FederateId(u16::from(script.byte().unwrap_or(0) % 3)));
                let _ = b.decline(script.object());
            }
            _ => {
                let segment = u32::try_from(script.number()).unwrap_or(0);
                b.detach(A, segment);
            }
        }
    }
    // Whatever a reader has sent, the ledger is right: blocks that are not held are free.
    a.reader_lost(B);
    while a.release(genuine.serial, A).is_ok() {}
    assert_eq!(a.stats().bytes_in_use, 0);
    opened
}

/// Offers memory of any length and kind.
fn attach_anything(a: &mut Store, b: &mut Store, script: &mut Script<'_>) {
    let segment = u32::try_from(script.number()).unwrap_or(u32::MAX);
    let len = script.number();
    let Ok(object) = a.put(&[MARK; 10], &[FederateId(2)]) else { return };
    let sealed = a.unannounced(FederateId(2)).pop();
    let fd = match (script.byte().unwrap_or(0) % 2, sealed) {
        (0, Some(sealed)) => sealed.as_fd().try_clone_to_owned(),
        _ => std::fs::File::open("/dev/null").map(Into::into),
    };
    a.reader_lost(FederateId(2));
    let Ok(fd) = fd else { return };
    if b.attach(A, segment, len, fd).is_ok() {
        assert!(len <= CAPACITY, "memory that does not exist is mapped, for {object:?}");
    }
}

/// Opens an object that may not exist, and returns whether it does. All of its bytes are mapped.
fn open(store: &mut Store, object: ObjectRef) -> bool {
    let Ok(opened) = store.open(object) else { return false };
    let bytes = opened.as_bytes();
    assert_eq!(bytes.len() as u64, object.len);
    assert!(object.offset.checked_add(object.len).is_some_and(|end| end <= CAPACITY));
    // The first and the last byte: outside of a mapping that would end this process.
    let known = [0, MARK];
    assert!(bytes.first().is_none_or(|byte| known.contains(byte)));
    assert!(bytes.last().is_none_or(|byte| known.contains(byte)));
    true
}
