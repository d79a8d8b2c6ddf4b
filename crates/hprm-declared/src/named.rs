//! How a program in Python is named: by its file, and perhaps by a reactor in that.

/// How the name of a file ends that is a program in Python.
const ENDING: &str = ".py";

/// A program in Python, as users name it: `app.py`, or `app.py:Vision`.
///
/// ```
/// use hprm_declared::NamedProgram;
///
/// let named = NamedProgram::parse("src/app.py:Vision").unwrap();
/// assert_eq!((named.file, named.reactor), ("src/app.py", Some("Vision")));
/// assert!(NamedProgram::parse("Main.lf").is_none());
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct NamedProgram<'p> {
    /// The path of the file.
    pub file: &'p str,
    /// What stands behind the colon, if there is one: a class, an object or a function. It may be empty.
    pub reactor: Option<&'p str>,
}

impl<'p> NamedProgram<'p> {
    /// Reads the name of a program; none if it is none in Python.
    ///
    /// A path that ends like a file in Python is one, whatever colons are in it; folders and files may have some.
    #[must_use]
    pub fn parse(path: &'p str) -> Option<Self> {
        if is_file(path) {
            return Some(Self { file: path, reactor: None });
        }
        let (file, reactor) = path.rsplit_once(':')?;
        let is_named = is_file(file) && !reactor.contains('/');
        is_named.then_some(Self { file, reactor: Some(reactor) })
    }
}

fn is_file(path: &str) -> bool {
    path.strip_suffix(ENDING).is_some_and(|stem| !stem.is_empty() && !stem.ends_with('/'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_and_a_reactor_are_told_apart() {
        for (path, file, reactor) in [
            ("app.py", "app.py", None),
            ("a/app.py:Vision", "a/app.py", Some("Vision")),
            ("app.py:Vision.Inner", "app.py", Some("Vision.Inner")),
            ("app.py:", "app.py", Some("")),
            ("a:b/app.py", "a:b/app.py", None),
            ("a:b/app.py:Vision", "a:b/app.py", Some("Vision")),
            ("old.py:new/app.py", "old.py:new/app.py", None),
            ("old.py:new/app.py:Vision", "old.py:new/app.py", Some("Vision")),
            ("app.py.py", "app.py.py", None),
            ("app.py.py:Vision", "app.py.py", Some("Vision")),
            ("app.py:Vision:Other.py", "app.py:Vision:Other.py", None),
            ("a:b.py:C", "a:b.py", Some("C")),
        ] {
            assert_eq!(NamedProgram::parse(path), Some(NamedProgram { file, reactor }), "{path}");
        }
    }

    #[test]
    fn what_is_no_program_in_python() {
        for path in
            ["", "py", ".py", "a/.py", ".py:Main", "Main.lf", "Main.lf:Main", "app.pyc", ":Main"]
        {
            assert_eq!(NamedProgram::parse(path), None, "{path}");
        }
        for path in ["app.py:a/b.lf", "app.py:a:b/c"] {
            assert_eq!(NamedProgram::parse(path), None, "{path}");
        }
    }
}
