//! Diagrams as SVG.

use std::fmt::Write as _;

use crate::graph::Graph;
use crate::scene::scene;
use crate::shape::{Color, Shape, Stroke, disc, number};
use crate::text::{FAMILY, drawn};

/// The diagram as a file; `images` gives the pictures that the program names, as what an attribute `href` may be.
#[must_use]
pub fn svg(graph: &Graph, images: &dyn Fn(&str) -> Option<String>) -> String {
    let (width, height) = (number(graph.size.x), number(graph.size.y));
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"{FAMILY}\">\n"
    );
    if let Some(node) = graph.nodes.first() {
        let title: String = node.title.iter().map(|(text, _)| text.as_str()).collect();
        let _ = writeln!(text, "<title>{}</title>", escaped(&title));
    }
    let _ = writeln!(text, "<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>");
    text.push_str(&body(graph, images));
    text.push_str("</svg>\n");
    text
}

/// What is in the picture.
pub(crate) fn body(graph: &Graph, images: &dyn Fn(&str) -> Option<String>) -> String {
    let mut text = String::new();
    for shape in scene(graph) {
        write(&shape, images, &mut text);
    }
    text
}

fn write(shape: &Shape, images: &dyn Fn(&str) -> Option<String>, out: &mut String) {
    let _ = match shape {
        Shape::Path { d, fill, stroke } => {
            let fill = fill.map_or("none".to_owned(), hex);
            let stroke = stroke.map(line).unwrap_or_default();
            writeln!(out, "<path d=\"{d}\" fill=\"{fill}\"{stroke}/>")
        }
        Shape::Frame { d, fill, stroke } => {
            writeln!(
                out,
                "<path class=\"frame\" d=\"{d}\" fill=\"{}\"{}/>",
                hex(*fill),
                line(*stroke)
            )
        }
        Shape::Sign { middle, open } => {
            let (x, y) = (middle.x, middle.y);
            let mut d = disc(*middle, 6.5);
            let _ = write!(d, "M{} {}h6", number(x - 3.0), number(y));
            if !open {
                let _ = write!(d, "M{} {}v6", number(x), number(y - 3.0));
            }
            writeln!(
                out,
                "<path class=\"sign\" d=\"{d}\" fill=\"#ffffff\" stroke=\"#59636e\" stroke-width=\"1.2\"/>"
            )
        }
        Shape::Text { at, text, style, color } => {
            let weight = if style.bold { " font-weight=\"bold\"" } else { "" };
            let begin = drawn(text);
            // A viewer shows all of it where the pointer rests.
            let whole = (begin != *text).then(|| format!("<title>{}</title>", escaped(text)));
            // Whichever font the viewer has, the text is as wide as it was measured.
            writeln!(
                out,
                "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-size=\"{}\"{weight} fill=\"{}\" \
                 textLength=\"{}\" lengthAdjust=\"spacingAndGlyphs\" xml:space=\"preserve\">{}{}</text>",
                number(at.x),
                number(at.y),
                number(style.size),
                hex(*color),
                number(style.width(text)),
                escaped(&begin),
                whole.unwrap_or_default(),
            )
        }
        Shape::Image { at, name } => match images(name) {
            Some(href) => writeln!(
                out,
                "<image x=\"{}\" y=\"{}\" width=\"18\" height=\"18\" href=\"{}\"/>",
                number(at.x),
                number(at.y),
                escaped(&href),
            ),
            None => Ok(()),
        },
        Shape::Begin { reactor, opens, open } => {
            let state = match (opens, open) {
                (false, _) => "",
                (true, true) => " data-open=\"1\"",
                (true, false) => " data-open=\"0\"",
            };
            writeln!(out, "<g data-reactor=\"{reactor}\"{state}>")
        }
        Shape::End => writeln!(out, "</g>"),
    };
}

fn line(stroke: Stroke) -> String {
    let dash = stroke
        .dash
        .lengths()
        .map(|[on, off]| format!(" stroke-dasharray=\"{} {}\"", number(on), number(off)));
    let (color, width) = (hex(stroke.color), number(stroke.width));
    let join = " stroke-linejoin=\"round\"";
    format!(" stroke=\"{color}\" stroke-width=\"{width}\"{join}{}", dash.unwrap_or_default())
}

fn hex(color: Color) -> String {
    format!("#{:06x}", color.0)
}

/// Text between tags or in quotes. Characters that XML does not have are left out.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' | '\t' | '\r' => out.push(' '),
            // Pages have other uses for these characters, which have no meaning of their own.
            '\u{e000}'..='\u{e0ff}' => out.push('\u{fffd}'),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => {}
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::escaped;

    #[test]
    fn text_cannot_end_its_element() {
        assert_eq!(escaped("a<b>&\"c\"\u{0}\n"), "a&lt;b&gt;&amp;&quot;c&quot; ");
    }
}
