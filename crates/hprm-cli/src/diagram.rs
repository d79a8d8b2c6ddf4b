//! `hprm diagram`: a picture of a program, as a file.
//!
//! `hprm-diagram` draws; this compiles the program, reads the pictures that it names, and writes the file. Because the
//! layout takes long to compile, it is in the command only with the feature `diagram`.

use std::process::ExitCode;

use crate::args::Diagram;
use crate::message::Error;

/// Draws a program.
///
/// # Errors
///
/// If there is no such program, or the file cannot be written.
#[cfg(feature = "diagram")]
pub(crate) fn diagram(wanted: &Diagram) -> Result<ExitCode, Error> {
    drawing::diagram(wanted)
}

/// Says how to get a command that can draw.
///
/// # Errors
///
/// Always.
#[cfg(not(feature = "diagram"))]
pub(crate) fn diagram(_: &Diagram) -> Result<ExitCode, Error> {
    Err(Error::new("this build of the command cannot draw diagrams").hint(
        "in a clone of HPRM: make build, pip install ., or cargo install --path crates/hprm-cli --features diagram",
    ))
}

#[cfg(feature = "diagram")]
mod drawing {
    use std::fs;
    use std::path::{Path, PathBuf};
    use std::process::ExitCode;

    use base64::prelude::{BASE64_STANDARD, Engine};
    use hprm_diagram::{Graph, build, layout, page, png, svg};
    use hprm_model::outline::Outline;

    use crate::args::Diagram;
    use crate::check;
    use crate::draft;
    use crate::message::{self, Error};
    use crate::source::Outcome;

    /// How many pixels of a PNG file are one of the diagram.
    const SCALE: f64 = 2.0;

    #[derive(Clone, Copy, PartialEq, Eq)]
    enum Format {
        Svg,
        Png,
        Html,
    }

    pub(super) fn diagram(wanted: &Diagram) -> Result<ExitCode, Error> {
        let format = format(wanted)?;
        let (mut outline, code) = match wanted.program().draw()? {
            Outcome::Undeclared(undeclared) => return Ok(check::show_undeclared(undeclared)),
            Outcome::Right(compiled) => {
                check::show_warnings(&compiled);
                (compiled.outline, ExitCode::SUCCESS)
            }
            Outcome::Wrong(failure) => {
                check::show_mistakes(&failure);
                (failure.outline.map(|outline| *outline), ExitCode::FAILURE)
            }
        };
        let Some(outline) = &mut outline else { return Ok(code) };
        let pictures = Pictures::read(outline, &wanted.file);
        let drawn = draw(outline, &pictures, (wanted, format))?;
        let path = match &wanted.output {
            Some(path) => path.clone(),
            None => PathBuf::from(format!("{}.svg", outline.reactors[0].name)),
        };
        draft::replace(&path, |draft| fs::write(draft, &drawn)).map_err(|error| {
            let error = message::reason(&error);
            Error::new(format!("cannot write {}: {error}", path.display()))
                .hint("--output names another file; its folder must be there")
        })?;
        message::print_line(&format!("wrote {}", path.display()));
        Ok(code)
    }

    fn format(wanted: &Diagram) -> Result<Format, Error> {
        match wanted.ending().as_deref() {
            Some("svg") => Ok(Format::Svg),
            Some("png") => Ok(Format::Png),
            Some("html") => Ok(Format::Html),
            _ => {
                let path = wanted.output.as_deref().unwrap_or(Path::new("")).display();
                Err(Error::option(format!("{path} has no ending of a picture"))
                    .hint("diagrams are written to files that end in .svg, .png or .html"))
            }
        }
    }

    fn draw(
        outline: &Outline,
        pictures: &Pictures,
        (wanted, format): (&Diagram, Format),
    ) -> Result<Vec<u8>, Error> {
        let depth = wanted.depth.map_or(usize::MAX, |depth| depth as usize);
        let placed = || -> Result<Graph, Error> {
            let mut graph = build(outline, &|reactor| depth_of(outline, reactor) < depth);
            layout(&mut graph).map_err(|error| {
                Error::new(format!("there is no layout of this program: {}", error.0))
                    .hint("this is a mistake of HPRM; --depth 1 draws less of the program")
            })?;
            Ok(graph)
        };
        match format {
            Format::Svg => Ok(svg(&placed()?, &|name| pictures.of(name)).into_bytes()),
            Format::Png => png(&placed()?, SCALE).ok_or_else(|| {
                Error::new("the diagram is too large for a PNG file")
                    .hint("write it to a file that ends in .svg or .html, or state --depth")
            }),
            Format::Html => match page(outline, &|name| pictures.of(name), wanted.depth) {
                Ok(text) => Ok(text.into_bytes()),
                Err(error) => {
                    Err(Error::new(format!("there is no layout of this program: {}", error.0)))
                }
            },
        }
    }

    /// How many reactors contain a reactor.
    fn depth_of(outline: &Outline, reactor: usize) -> usize {
        let mut depth = 0;
        let mut at = reactor;
        while let Some(parent) = outline.reactors[at].parent {
            at = parent;
            depth += 1;
        }
        depth
    }

    /// The pictures that `@icon` names, as addresses that have the whole picture.
    struct Pictures(Vec<(String, String)>);

    impl Pictures {
        /// Reads them, relative to the program. One that cannot be read is said, and left out.
        fn read(outline: &mut Outline, program: &Path) -> Self {
            let folder = program.parent().unwrap_or(Path::new(""));
            let mut found: Vec<(String, String)> = Vec::new();
            for reactor in &mut outline.reactors {
                let Some(name) = reactor.drawing.icon.clone() else { continue };
                if found.iter().any(|(known, _)| *known == name) {
                    continue;
                }
                match address(&folder.join(&name)) {
                    Ok(address) => found.push((name, address)),
                    Err(why) => {
                        Error::new(format!("the icon {name} is left out: {why}")).show_as_warning();
                        reactor.drawing.icon = None;
                    }
                }
            }
            Self(found)
        }

        fn of(&self, name: &str) -> Option<String> {
            self.0.iter().find(|(known, _)| known == name).map(|(_, address)| address.clone())
        }
    }

    fn address(path: &Path) -> Result<String, String> {
        const KINDS: [(&str, &str); 5] =
            [("gif", "gif"), ("jpeg", "jpeg"), ("jpg", "jpeg"), ("png", "png"), ("svg", "svg+xml")];
        let ending = path.extension().and_then(|it| it.to_str()).unwrap_or_default().to_lowercase();
        let kind = KINDS.iter().find(|(known, _)| *known == ending);
        let (_, kind) = kind.ok_or("it is no .png, .jpg, .gif or .svg file")?;
        let bytes = fs::read(path).map_err(|error| message::reason(&error))?;
        Ok(format!("data:image/{kind};base64,{}", BASE64_STANDARD.encode(bytes)))
    }

    #[cfg(test)]
    mod tests {
        use super::{address, fs};

        #[test]
        fn bytes_become_base64() {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("icon.png");
            let texts = ["", "f", "fo", "foo", "foob"].map(|text| {
                fs::write(&path, text).unwrap();
                address(&path).unwrap()
            });
            let expected = ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg=="];
            assert_eq!(texts, expected.map(|text| format!("data:image/png;base64,{text}")));
        }
    }
}
