//! How much of a text is drawn, and how wide that is: measured in the font that pictures name first, and that PNG files
//! are drawn with.
//!
//! SVG states the measured width of each text, so a viewer without the font fits another one into the same space.

use std::borrow::Cow;

use ttf_parser::Face;

/// The most characters of a text that are drawn.
const LONGEST: usize = 48;

/// What SVG asks for: the font that is measured here, those with the same widths, and any other.
pub(crate) const FAMILY: &str = "Arimo, 'Liberation Sans', Arial, Helvetica, sans-serif";

static REGULAR: &[u8] = include_bytes!("font/Arimo-Regular.ttf");
static BOLD: &[u8] = include_bytes!("font/Arimo-Bold.ttf");

/// How text looks.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Style {
    /// Its size, in pixels.
    pub size: f64,
    /// Whether it is bold.
    pub bold: bool,
}

impl Style {
    /// The height of a line.
    #[must_use]
    pub fn line(self) -> f64 {
        (self.size * 1.3).ceil()
    }

    /// How wide `text` is, as far as it is drawn, in pixels.
    #[must_use]
    pub fn width(self, text: &str) -> f64 {
        let face = face(self.bold);
        let em = f64::from(face.units_per_em());
        let advance = |c: char| {
            // What the font lacks is drawn with another one, and is rarely wider than it is high.
            let glyph = face.glyph_index(c).and_then(|glyph| face.glyph_hor_advance(glyph));
            glyph.map_or(em, f64::from)
        };
        drawn(text).chars().map(advance).sum::<f64>() * self.size / em
    }
}

/// The font.
pub(crate) fn face(bold: bool) -> Face<'static> {
    Face::parse(if bold { BOLD } else { REGULAR }, 0).expect("the font is part of the crate")
}

/// What is drawn of a text: its beginning, if it is long.
pub(crate) fn drawn(text: &str) -> Cow<'_, str> {
    match text.chars().count() <= LONGEST {
        true => text.into(),
        false => text.chars().take(LONGEST - 1).chain(['…']).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_are_those_of_arial() {
        let style = Style { size: 1000.0, bold: false };
        assert!((style.width("W") - 944.0).abs() < 1.0, "{}", style.width("W"));
        assert!((style.width("il") - 444.0).abs() < 1.0, "{}", style.width("il"));
        assert!(Style { bold: true, ..style }.width("il") > style.width("il"));
        assert!((style.width("日本") - 2000.0).abs() < 1.0);
    }
}
