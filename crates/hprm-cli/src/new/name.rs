//! What a project may be called, and its name as languages write it.

use std::path::Path;

use crate::args::Language;
use crate::message::Error;

/// Modules of Python's standard library, which a package of that name would hide.
const STANDARD_MODULES: &str = include_str!("../../templates/python/taken.txt");

/// Names that mean something else to Python, pytest or cargo. Most are keywords.
const TAKEN: &str = include_str!("../../templates/taken.txt");

/// The name of a project.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Name {
    words: Vec<String>,
}

impl Name {
    /// The name of the project in this folder.
    ///
    /// # Errors
    ///
    /// If it is no name in one of the languages.
    pub(super) fn of(folder: &Path, language: Language) -> Result<Self, Error> {
        let stated = folder.file_name().and_then(|name| name.to_str());
        let Some(stated) = stated else {
            return Err(Error::option(format!("{} ends with no name", folder.display()))
                .hint("name a folder to make, such as robot"));
        };
        let wrong = |why: &str| {
            Err(Error::option(format!("a project cannot be called {stated}: {why}"))
                .hint("a name such as robot or robot-arm will do"))
        };
        if !stated.starts_with(|first: char| first.is_ascii_alphabetic()) {
            return wrong("it must begin with a letter from A to Z or a to z");
        }
        if !stated.chars().all(|char| char.is_ascii_alphanumeric() || matches!(char, '-' | '_')) {
            return wrong("it may have ASCII letters, digits, - and _ only");
        }
        let words: Vec<_> = words(stated);
        let name = Self { words };
        let snake = name.snake();
        if TAKEN.lines().any(|word| word == snake) {
            return wrong("the name has a meaning of its own");
        }
        if language == Language::Python && STANDARD_MODULES.lines().any(|module| module == snake) {
            return wrong("a module of Python's standard library has this name");
        }
        Ok(name)
    }

    /// As types and files of Lingua Franca have it: `RobotArm`.
    pub(super) fn pascal(&self) -> String {
        let capital = |word: &String| word[..1].to_ascii_uppercase() + &word[1..];
        self.words.iter().map(capital).collect()
    }

    /// As modules have it: `robot_arm`.
    pub(super) fn snake(&self) -> String {
        self.words.join("_")
    }

    /// Puts the name where a template has its own.
    pub(super) fn instead_of_template(&self, text: &str) -> String {
        text.replace("new_project", &self.snake())
            .replace("NewProject", &self.pascal())
            .replace("new-project", &self.words.join("-"))
    }
}

/// The words of a name, in lower case: those of `robotArm2-left` are robot, arm2 and left.
fn words(name: &str) -> Vec<String> {
    let mut words = Vec::new();
    for part in name.split(['-', '_']).filter(|part| !part.is_empty()) {
        let mut word = String::new();
        let mut was_lower = false;
        for char in part.chars() {
            if char.is_ascii_uppercase() && was_lower {
                words.push(std::mem::take(&mut word));
            }
            was_lower = !char.is_ascii_uppercase();
            word.push(char.to_ascii_lowercase());
        }
        words.push(word);
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(stated: &str) -> Result<Name, Error> {
        Name::of(Path::new(stated), Language::Python)
    }

    #[test]
    fn a_name_is_written_as_each_language_does() {
        for (stated, snake, pascal) in [
            ("robot", "robot", "Robot"),
            ("projects/robot-arm", "robot_arm", "RobotArm"),
            ("RobotArm", "robot_arm", "RobotArm"),
            ("robot_2", "robot_2", "Robot2"),
            ("LIDAR", "lidar", "Lidar"),
            ("a--b_", "a_b", "AB"),
        ] {
            let name = name(stated).unwrap();
            assert_eq!((&*name.snake(), &*name.pascal()), (snake, pascal));
        }
    }

    #[test]
    fn the_template_has_no_trace_of_its_own_name() {
        let text = "new_project NewProject new-project";
        assert_eq!(
            name("RobotArm").unwrap().instead_of_template(text),
            "robot_arm RobotArm robot-arm"
        );
    }

    #[test]
    fn a_name_that_a_language_would_misunderstand_is_refused() {
        for (stated, why) in [
            ("2d", "must begin with a letter"),
            ("-robot", "must begin with a letter"),
            ("ro bot", "ASCII letters"),
            ("röbot", "ASCII letters"),
            ("class", "a meaning of its own"),
            ("Self", "a meaning of its own"),
            ("hprm", "a meaning of its own"),
            ("pytest", "a meaning of its own"),
            ("signal", "standard library"),
            ("..", "ends with no name"),
        ] {
            let error = format!("{:?}", name(stated).unwrap_err());
            assert!(error.contains(why), "{stated}: {error}");
        }
        // It hides nothing there.
        assert!(Name::of(Path::new("signal"), Language::Lf).is_ok());
    }
}
