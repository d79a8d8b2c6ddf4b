//! Shapes, and outlines of them as paths.

use std::fmt::Write as _;

use crate::graph::{Point, Rect};
use crate::text::Style;

/// Something to draw.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum Shape {
    /// An outline, in the syntax of SVG paths, with the commands `M`, `L`, `C` and `Z` only.
    Path { d: String, fill: Option<Color>, stroke: Option<Stroke> },
    /// The outline of a box.
    Frame { d: String, fill: Color, stroke: Stroke },
    /// The sign that says whether a reactor is open, in pages.
    Sign { middle: Point, open: bool },
    /// A line of text; the point is the middle of its base line.
    Text { at: Point, text: String, style: Style, color: Color },
    /// A picture that the program names; the point is its upper left corner.
    Image { at: Point, name: String },
    /// What follows belongs to this reactor, until the end.
    Begin { reactor: usize, opens: bool, open: bool },
    /// The end of what belongs to a reactor.
    End,
}

/// How a line is drawn.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Stroke {
    pub(crate) color: Color,
    pub(crate) width: f64,
    pub(crate) dash: Dash,
}

/// How a line is broken.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Dash {
    Solid,
    Dashed,
    Dotted,
}

impl Dash {
    /// What is drawn, and what is left out.
    pub(crate) fn lengths(self) -> Option<[f64; 2]> {
        match self {
            Self::Solid => None,
            Self::Dashed => Some([4.0, 3.0]),
            Self::Dotted => Some([1.5, 3.0]),
        }
    }
}

/// A color: red, green and blue.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Color(pub(crate) u32);

/// A number with two digits at most after the point.
pub(crate) fn number(value: f64) -> String {
    let text = format!("{:.2}", value + 0.0);
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// A path, command by command.
#[derive(Default)]
pub(crate) struct Path(String);

impl Path {
    pub(crate) fn to(mut self, command: char, points: &[Point]) -> Self {
        self.0.push(command);
        for (at, point) in points.iter().enumerate() {
            let space = if at == 0 { "" } else { " " };
            let _ = write!(self.0, "{space}{} {}", number(point.x), number(point.y));
        }
        self
    }

    pub(crate) fn close(mut self) -> String {
        self.0.push('Z');
        self.0
    }

    pub(crate) fn open(self) -> String {
        self.0
    }
}

/// A line through points.
pub(crate) fn line(points: &[Point]) -> String {
    let first = Path::default().to('M', &points[..1]);
    points[1..].iter().fold(first, |path, point| path.to('L', &[*point])).open()
}

/// What a line around points encloses.
pub(crate) fn polygon(points: &[Point]) -> String {
    line(points) + "Z"
}

/// A line through points, with round corners where there is room for them.
pub(crate) fn rounded_line(points: &[Point], radius: f64) -> String {
    let mut path = Path::default().to('M', &points[..1]);
    for corner in points.windows(3) {
        let [before, at, after] = [corner[0], corner[1], corner[2]];
        let radius = radius.min(distance(before, at) / 2.0).min(distance(at, after) / 2.0);
        let (begin, end) = (toward(at, before, radius), toward(at, after, radius));
        // Two thirds of the way to the corner make a quadratic curve.
        let (first, second) =
            (toward(begin, at, radius * 2.0 / 3.0), toward(end, at, radius * 2.0 / 3.0));
        path = path.to('L', &[begin]).to('C', &[first, second, end]);
    }
    path.to('L', &points[points.len() - 1..]).open()
}

/// A rectangle with round corners.
pub(crate) fn rounded(rect: Rect, radius: f64) -> String {
    let radius = radius.min(rect.w / 2.0).min(rect.h / 2.0);
    let point = |x, y| Point { x, y };
    let (left, top, right, bottom) = (rect.x, rect.y, rect.right(), rect.bottom());
    let corners = [point(right, top), point(right, bottom), point(left, bottom), point(left, top)];
    let mut path = Path::default().to('M', &[point(left + radius, top)]);
    for (at, corner) in corners.into_iter().enumerate() {
        let before = corners[(at + 3) % 4];
        let after = corners[(at + 1) % 4];
        let (begin, end) = (toward(corner, before, radius), toward(corner, after, radius));
        let (first, second) =
            (toward(begin, corner, radius * KAPPA), toward(end, corner, radius * KAPPA));
        path = path.to('L', &[begin]).to('C', &[first, second, end]);
    }
    path.close()
}

/// A disc.
pub(crate) fn disc(middle: Point, radius: f64) -> String {
    let side = 2.0 * radius;
    rounded(Rect { x: middle.x - radius, y: middle.y - radius, w: side, h: side }, radius)
}

/// How far the handles of a curve are that looks like a quarter of a disc.
const KAPPA: f64 = 0.5523;

fn distance(a: Point, b: Point) -> f64 {
    (a.x - b.x).hypot(a.y - b.y)
}

/// The point that is `length` from `from` on the way to `to`.
fn toward(from: Point, to: Point, length: f64) -> Point {
    let distance = distance(from, to);
    if distance == 0.0 {
        return from;
    }
    let part = length / distance;
    Point { x: from.x + (to.x - from.x) * part, y: from.y + (to.y - from.y) * part }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let numbers = [0.0, -0.001, 12.5, 3.456, 100.0, -7.1].map(number);
        assert_eq!(numbers, ["0", "0", "12.5", "3.46", "100", "-7.1"]);
    }

    #[test]
    fn a_corner_is_no_longer_than_the_line() {
        let at = |x, y| Point { x, y };
        let path = rounded_line(&[at(0.0, 0.0), at(2.0, 0.0), at(2.0, 50.0)], 8.0);
        assert!(path.starts_with("M0 0L1 0C"), "{path}");
    }
}
