//! What federates write, line by line behind their names.
//!
//! Bytes pass unchanged, whatever their encoding. A line is written in one piece, so lines of
//! different federates never mix.

/// The longest line that is kept together, in bytes. A longer one is cut: memory is finite.
const LONGEST: usize = 1 << 20;

/// Cuts one stream into lines.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Lines {
    prefix: Vec<u8>,
    /// The beginning of a line whose end has not come yet.
    partial: Vec<u8>,
}

impl Lines {
    /// Lines that start with `[name] `.
    pub(super) fn of(name: &str) -> Self {
        Self { prefix: format!("[{name}] ").into_bytes(), partial: Vec::new() }
    }

    /// Takes bytes as they come, and gives the lines that they complete.
    pub(super) fn take(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut lines = Vec::new();
        for piece in bytes.split_inclusive(|byte| *byte == b'\n') {
            self.partial.extend_from_slice(piece);
            if piece.ends_with(b"\n") || self.partial.len() >= LONGEST {
                self.complete(&mut lines);
            }
        }
        lines
    }

    /// What is left when the stream ends: a line without its end, which it gets here.
    pub(super) fn end(&mut self) -> Vec<u8> {
        let mut lines = Vec::new();
        if !self.partial.is_empty() {
            self.complete(&mut lines);
        }
        lines
    }

    fn complete(&mut self, lines: &mut Vec<u8>) {
        lines.extend_from_slice(&self.prefix);
        lines.append(&mut self.partial);
        if !lines.ends_with(b"\n") {
            lines.push(b'\n');
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{LONGEST, Lines};

    #[test]
    fn a_line_waits_for_its_end() {
        let mut lines = Lines::of("a");
        assert_eq!(lines.take(b"one\ntw"), b"[a] one\n");
        assert_eq!(lines.take(b"o"), b"");
        assert_eq!(lines.take(b"\n\nthree"), b"[a] two\n[a] \n");
        assert_eq!(lines.end(), b"[a] three\n");
        assert_eq!(lines.end(), b"");
    }

    #[test]
    fn bytes_need_not_be_text() {
        let mut lines = Lines::of("client__2");
        assert_eq!(lines.take(b"\xff\xfe\r\x00\n"), b"[client__2] \xff\xfe\r\x00\n");
    }

    #[test]
    fn an_endless_line_is_cut() {
        let mut lines = Lines::of("a");
        let mut written = Vec::new();
        for _ in 0..LONGEST / 1024 * 2 {
            written.extend(lines.take(&[b'x'; 1024]));
            assert!(lines.partial.len() < LONGEST);
        }
        assert_eq!(written.iter().filter(|byte| **byte == b'\n').count(), 2);
        assert_eq!(written.iter().filter(|byte| **byte == b'x').count(), 2 * LONGEST);
    }
}
