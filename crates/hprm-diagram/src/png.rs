//! Diagrams as PNG.

use tiny_skia::{FillRule, LineCap, LineJoin, Paint, PathBuilder, Pixmap, StrokeDash, Transform};
use ttf_parser::OutlineBuilder;

use crate::graph::{Graph, Point};
use crate::scene::scene;
use crate::shape::{Color, Shape, Stroke};
use crate::text::{Style, drawn, face};

/// The most pixels of a picture.
const MOST: f64 = 100_000_000.0;

/// The diagram as a file with `scale` pixels for each; fewer if it would be too large. None if it is too large
/// nevertheless.
#[must_use]
pub fn png(graph: &Graph, scale: f64) -> Option<Vec<u8>> {
    let scale = possible(scale, graph.size);
    let pixels = |length: f64| to_u32((length * scale).ceil().max(1.0));
    let mut canvas = Pixmap::new(pixels(graph.size.x), pixels(graph.size.y))?;
    canvas.fill(tiny_skia::Color::WHITE);
    let zoom = to_f32(scale);
    let transform = Transform::from_scale(zoom, zoom);
    for shape in scene(graph) {
        match shape {
            Shape::Path { d, fill, stroke } => {
                let Some(path) = path(&d) else { continue };
                if let Some(color) = fill {
                    canvas.fill_path(&path, &paint(color), FillRule::Winding, transform, None);
                }
                if let Some(stroke) = stroke {
                    let paint = paint(stroke.color);
                    canvas.stroke_path(&path, &paint, &line(stroke), transform, None);
                }
            }
            Shape::Frame { d, fill, stroke } => {
                let Some(path) = path(&d) else { continue };
                canvas.fill_path(&path, &paint(fill), FillRule::Winding, transform, None);
                let color = paint(stroke.color);
                canvas.stroke_path(&path, &color, &line(stroke), transform, None);
            }
            Shape::Text { at, text, style, color } => {
                if let Some(path) = glyphs(at, &text, style) {
                    canvas.fill_path(&path, &paint(color), FillRule::Winding, transform, None);
                }
            }
            Shape::Image { .. } | Shape::Sign { .. } | Shape::Begin { .. } | Shape::End => {}
        }
    }
    canvas.encode_png().ok()
}

/// A scale with which a picture of this size does not have too many pixels.
fn possible(scale: f64, size: Point) -> f64 {
    scale.min((MOST / (size.x * size.y).max(1.0)).sqrt())
}

#[expect(clippy::cast_possible_truncation, reason = "coordinates of a picture")]
fn to_f32(value: f64) -> f32 {
    value as f32
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a bounded size")]
fn to_u32(value: f64) -> u32 {
    value as u32
}

fn paint(color: Color) -> Paint<'static> {
    let [_, r, g, b] = color.0.to_be_bytes();
    let mut paint = Paint::default();
    paint.set_color_rgba8(r, g, b, 255);
    paint
}

fn line(stroke: Stroke) -> tiny_skia::Stroke {
    tiny_skia::Stroke {
        width: to_f32(stroke.width),
        line_cap: LineCap::Butt,
        line_join: LineJoin::Round,
        dash: stroke
            .dash
            .lengths()
            .and_then(|lengths| StrokeDash::new(lengths.map(to_f32).to_vec(), 0.0)),
        ..tiny_skia::Stroke::default()
    }
}

/// An outline in the syntax of SVG, with the commands that [`Shape::Path`] may have.
fn path(d: &str) -> Option<tiny_skia::Path> {
    let mut builder = PathBuilder::new();
    let mut rest = d;
    while let Some(command) = rest.chars().next() {
        let end = rest[1..].find(|c: char| c.is_ascii_alphabetic()).map_or(rest.len(), |at| at + 1);
        let numbers = rest[1..end].split(' ').filter_map(|it| it.parse::<f32>().ok());
        match (command, numbers.collect::<Vec<_>>().as_slice()) {
            ('M', [x, y]) => builder.move_to(*x, *y),
            ('L', [x, y]) => builder.line_to(*x, *y),
            ('C', [a, b, c, d, x, y]) => builder.cubic_to(*a, *b, *c, *d, *x, *y),
            ('Z', _) => builder.close(),
            _ => return None,
        }
        rest = &rest[end..];
    }
    builder.finish()
}

/// The outlines of text.
fn glyphs(at: Point, text: &str, style: Style) -> Option<tiny_skia::Path> {
    let face = face(style.bold);
    let scale = style.size / f64::from(face.units_per_em());
    let mut pen =
        Pen { builder: PathBuilder::new(), x: at.x - style.width(text) / 2.0, y: at.y, scale };
    for c in drawn(text).chars() {
        let glyph = face.glyph_index(c);
        // What the font lacks is its sign for that.
        face.outline_glyph(glyph.unwrap_or(ttf_parser::GlyphId(0)), &mut pen);
        let advance = glyph.and_then(|glyph| face.glyph_hor_advance(glyph));
        pen.x += f64::from(advance.unwrap_or(face.units_per_em())) * scale;
    }
    pen.builder.finish()
}

struct Pen {
    builder: PathBuilder,
    x: f64,
    y: f64,
    scale: f64,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        let x = self.x + f64::from(x) * self.scale;
        let y = self.y - f64::from(y) * self.scale;
        (to_f32(x), to_f32(y))
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.builder.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.builder.line_to(x, y);
    }

    fn quad_to(&mut self, a: f32, b: f32, x: f32, y: f32) {
        let ((a, b), (x, y)) = (self.at(a, b), self.at(x, y));
        self.builder.quad_to(a, b, x, y);
    }

    fn curve_to(&mut self, a: f32, b: f32, c: f32, d: f32, x: f32, y: f32) {
        let ((a, b), (c, d), (x, y)) = (self.at(a, b), self.at(c, d), self.at(x, y));
        self.builder.cubic_to(a, b, c, d, x, y);
    }

    fn close(&mut self) {
        self.builder.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_that_is_too_large_has_fewer_pixels() {
        let scale = |x, y| possible(2.0, Point { x, y });
        assert!((scale(1000.0, 1000.0) - 2.0).abs() < 1e-9);
        assert!((scale(100_000.0, 10_000.0) - 0.1_f64.sqrt()).abs() < 1e-9);
    }
}
