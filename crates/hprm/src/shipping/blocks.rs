//! Compressed shipments: their bytes in blocks, each compressed by itself, or as it is if that is shorter.
//!
//! ```text
//! for each block:  len:u32, little endian; the highest bit says that what follows is not compressed   bytes
//! ```

use std::io;

use lz4_flex::block::{compress_into, decompress_into, get_maximum_output_size};

/// The bytes of a block before it is compressed, but for the last one.
pub(super) const BLOCK: usize = 256 << 10;

/// The bytes before a block.
pub(super) const HEAD: usize = 4;

const IS_PLAIN: u32 = 1 << 31;

/// A block as it travels.
pub(super) fn packed(block: &[u8]) -> Vec<u8> {
    let mut piece = vec![0; HEAD + get_maximum_output_size(block.len())];
    let len = compress_into(block, &mut piece[HEAD..]).ok().filter(|len| *len < block.len());
    let (len, flag) = match len {
        Some(len) => (len, 0),
        None => {
            piece[HEAD..HEAD + block.len()].copy_from_slice(block);
            (block.len(), IS_PLAIN)
        }
    };
    piece.truncate(HEAD + len);
    let head = u32::try_from(len).expect("a block is short") | flag;
    piece[..HEAD].copy_from_slice(&head.to_le_bytes());
    piece
}

/// How many bytes are missing of a block of which these have come; none if no block is so long.
pub(super) fn missing(piece: &[u8]) -> Option<usize> {
    let Some((head, rest)) = piece.split_first_chunk::<HEAD>() else {
        return Some(HEAD - piece.len());
    };
    let len = (u32::from_le_bytes(*head) & !IS_PLAIN) as usize;
    (len > 0 && len <= BLOCK).then(|| len.checked_sub(rest.len()))?
}

/// Takes a whole block apart, which has as many bytes as `into`.
///
/// # Errors
///
/// If it is no such block.
pub(super) fn unpack(piece: &[u8], into: &mut [u8]) -> io::Result<()> {
    let wrong = || io::Error::new(io::ErrorKind::InvalidData, "this is no block of a shipment");
    let (head, bytes) = piece.split_first_chunk::<HEAD>().ok_or_else(wrong)?;
    if u32::from_le_bytes(*head) & IS_PLAIN != 0 {
        if bytes.len() != into.len() {
            return Err(wrong());
        }
        into.copy_from_slice(bytes);
        return Ok(());
    }
    let len = decompress_into(bytes, into).map_err(|_| wrong())?;
    if len == into.len() { Ok(()) } else { Err(wrong()) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_block_is_what_it_was(noise in prop::collection::vec(any::<u8>(), 1..300), times in 1..500_usize) {
            let block = noise.repeat(times);
            let block = &block[..block.len().min(BLOCK)];
            let piece = packed(block);
            prop_assert!(piece.len() <= HEAD + block.len());
            prop_assert_eq!(missing(&piece), Some(0));
            prop_assert_eq!(missing(&piece[..HEAD]), Some(piece.len() - HEAD));
            let mut into = vec![0; block.len()];
            unpack(&piece, &mut into).unwrap();
            prop_assert_eq!(&into[..], block);
            prop_assert!(unpack(&piece, &mut vec![0; block.len() + 1]).is_err());
        }

        #[test]
        fn any_bytes_are_a_block_or_an_error(piece in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = missing(&piece);
            let _ = unpack(&piece, &mut [0; 100]);
        }
    }
}
