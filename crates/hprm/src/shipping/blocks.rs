//! Compressed pieces of shipments, each compressed by itself.

use std::io;

use lz4_flex::block::{compress_into, decompress_into, get_maximum_output_size};

/// The most bytes of a piece.
pub(super) const BLOCK: usize = 256 << 10;

/// A piece as it travels; none if it would not be shorter.
pub(super) fn packed(piece: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = vec![0; get_maximum_output_size(piece.len())];
    let len = compress_into(piece, &mut bytes).ok().filter(|len| *len < piece.len())?;
    bytes.truncate(len);
    Some(bytes)
}

/// Takes a piece apart, which has as many bytes as `into`.
///
/// # Errors
///
/// If it is no such piece.
pub(super) fn unpack(bytes: &[u8], into: &mut [u8]) -> io::Result<()> {
    if decompress_into(bytes, into).ok() == Some(into.len()) {
        return Ok(());
    }
    Err(io::Error::new(io::ErrorKind::InvalidData, "this is no piece of a shipment"))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_piece_is_what_it_was(noise in prop::collection::vec(any::<u8>(), 1..300), times in 1..500_usize) {
            let piece = noise.repeat(times);
            let piece = &piece[..piece.len().min(BLOCK)];
            if let Some(bytes) = packed(piece) {
                prop_assert!(bytes.len() < piece.len());
                let mut into = vec![0; piece.len()];
                unpack(&bytes, &mut into).unwrap();
                prop_assert_eq!(&into[..], piece);
                prop_assert!(unpack(&bytes, &mut vec![0; piece.len() + 1]).is_err());
            }
        }

        #[test]
        fn any_bytes_are_a_piece_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = unpack(&bytes, &mut [0; 100]);
        }
    }
}
