//! Python bodies: where `{= ... =}` ends.

use hprm_model::python::Scanner;

use crate::unclosed;

/// Where a body ends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum End {
    /// Offset of the `=}` that ends it.
    At(usize),
    /// It has none. The text of the language goes on at `resume`; `next` is the body that begins
    /// inside, if there is one.
    Missing { resume: usize, next: Option<usize> },
}

/// The end of the body whose text starts at `start`.
pub(crate) fn end(text: &str, start: usize) -> End {
    let (bytes, mut scanner) = (text.as_bytes(), Scanner::new(text));
    let mut at = start;
    while at < bytes.len() {
        if bytes[at..].starts_with(b"=}") {
            return End::At(at);
        }
        if bytes[at..].starts_with(b"{=") {
            return missing(text, start, (at, Some(at)));
        }
        at = scanner.skip(at);
    }
    missing(text, start, (text.len(), None))
}

/// A body from `start` that has no end before `limit`.
fn missing(text: &str, start: usize, (limit, next): (usize, Option<usize>)) -> End {
    let mut code = Vec::new();
    let (bytes, mut scanner) = (text.as_bytes(), Scanner::new(text));
    let (mut at, mut depth) = (start, 0_usize);
    while at < limit {
        if depth == 0 {
            code.push(at);
        }
        match bytes[at] {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        at = scanner.skip(at);
    }
    let is_code = |offset| code.binary_search(&offset).is_ok();
    End::Missing { resume: unclosed::resume(text, start, limit, is_code), next }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_ends_outside_strings_and_comments() {
        for inside in [
            "",
            " x ",
            "\"=}\"",
            "'=}'",
            "f'{x=}'",
            "'''\n=}\n'''",
            "\"\"\" \" =} \"\"\"",
            "# =}\n",
            "'\\'=}'",
            "7 // 2 ",
            " = ",
            "{}",
            "r'\\' ",
            "don't ",
            "\"\"",
        ] {
            let text = format!("{{={inside}=}} rest =}}");
            assert_eq!(end(&text, 2), End::At(2 + inside.len()), "{text}");
        }
        assert_eq!(end("{= x }", 2), End::Missing { resume: 6, next: None });
        let missing = |resume, next| End::Missing { resume, next: Some(next) };
        assert_eq!(end("{= '{='\n}\n  reaction(){==}", 2), missing(9, 22));
        assert_eq!(end("{= ({\n}\n)\n  a=[{=", 2), missing(10, 15));
    }
}
