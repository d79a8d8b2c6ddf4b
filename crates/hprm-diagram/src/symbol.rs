//! The shapes of reactions, timers, actions, ports, and of the ends of lines.

use hprm_core::Direction;

use crate::graph::{
    Edge, EdgeKind, Graph, Kind, Node, Point, Port, PortShape, REACTION, Rect, SMALL, Side,
};
use crate::layout::{POINT, symbol};
use crate::scene::{FAINT, INK, LINE, RED, WHITE};
use crate::shape::{Color, Dash, Path, Shape, Stroke, disc, line, polygon};
use crate::text::Style;

const REACTION_FILL: Color = Color(0xc3_ca_d3);
const REACTION_BORDER: Color = Color(0x6e_77_81);
const RED_FILL: Color = Color(0xff_d3_d0);

pub(crate) fn thin(color: Color) -> Stroke {
    Stroke { color, width: 1.0, dash: Dash::Solid }
}

/// Text whose middle is at that point.
pub(crate) fn text(
    middle: Point,
    text: &str,
    (style, color): (Style, Color),
    shapes: &mut Vec<Shape>,
) {
    // Capital letters are 0.72 of the size of the font, and in the middle of the line.
    let at = Point { x: middle.x, y: middle.y + style.size * 0.36 };
    shapes.push(Shape::Text { at, text: text.to_owned(), style, color });
}

/// The symbol of a node that is no box.
pub(crate) fn draw(node: &Node, shapes: &mut Vec<Shape>) {
    let size = symbol(node);
    let x = node.rect.x + (node.rect.w - size.x) / 2.0;
    let rect = Rect { x, y: node.rect.y, w: size.x, h: size.y };
    let middle = rect.center();
    let mut path = |d: String, fill: Option<Color>, stroke: Stroke| {
        shapes.push(Shape::Path { d, fill, stroke: Some(stroke) });
    };
    match &node.kind {
        Kind::Reaction { deadline } => reaction(node, rect, deadline.as_deref(), shapes),
        Kind::Timer => {
            path(disc(middle, rect.w / 2.0 - 0.5), Some(WHITE), thin(LINE));
            let hand = |x: f64, y: f64| Point { x: middle.x + x, y: middle.y + y };
            let hands = [hand(0.0, -10.0), hand(0.0, 0.0), hand(7.0, 4.0)];
            path(line(&hands), None, Stroke { width: 1.4, ..thin(LINE) });
        }
        Kind::Action { physical } => {
            let corner = |x, y| Point { x, y };
            let corners = [
                corner(middle.x, rect.y),
                corner(rect.right(), rect.bottom()),
                corner(rect.x, rect.bottom()),
            ];
            path(polygon(&corners), Some(WHITE), thin(LINE));
            let letter = if *physical { "P" } else { "L" };
            let at = Point { x: middle.x, y: middle.y + 3.0 };
            text(at, letter, (Style { size: 9.0, ..REACTION }, INK), shapes);
        }
        Kind::Startup => path(disc(middle, rect.w / 2.0 - 0.5), Some(WHITE), thin(LINE)),
        Kind::Shutdown => {
            let corner = |x: f64, y: f64| Point { x: middle.x + x, y: middle.y + y };
            let half = rect.w / 2.0;
            let corners =
                [corner(0.0, -half), corner(half, 0.0), corner(0.0, half), corner(-half, 0.0)];
            path(polygon(&corners), Some(WHITE), thin(LINE));
        }
        Kind::Reset => {
            path(disc(middle, rect.w / 2.0 - 0.5), Some(WHITE), thin(LINE));
            let at = |x: f64, y: f64| Point { x: middle.x + x, y: middle.y + y };
            let arc = Path::default()
                .to('M', &[at(3.6, -2.6)])
                .to('C', &[at(1.2, -5.6), at(-4.2, -4.6), at(-4.4, 0.0)])
                .to('C', &[at(-4.4, 5.2), at(3.4, 6.0), at(4.4, 1.2)]);
            path(arc.open(), None, Stroke { width: 1.2, ..thin(LINE) });
            path(polygon(&[at(5.2, -4.8), at(4.6, -0.6), at(1.2, -2.6)]), Some(LINE), thin(LINE));
        }
        Kind::Reactor(_) | Kind::Modes | Kind::Mode { .. } => {}
    }
}

fn reaction(node: &Node, rect: Rect, deadline: Option<&str>, shapes: &mut Vec<Shape>) {
    let at = |x, y| Point { x, y };
    let middle = rect.center();
    let corners = [
        at(rect.x, rect.y),
        at(rect.right() - POINT, rect.y),
        at(rect.right(), middle.y),
        at(rect.right() - POINT, rect.bottom()),
        at(rect.x, rect.bottom()),
        at(rect.x + POINT, middle.y),
    ];
    let (fill, border) = if node.red { (RED_FILL, RED) } else { (REACTION_FILL, REACTION_BORDER) };
    let stroke = Stroke { width: if node.red { 1.5 } else { 1.0 }, ..thin(border) };
    shapes.push(Shape::Path { d: polygon(&corners), fill: Some(fill), stroke: Some(stroke) });
    let name = node.title.first().map_or("", |(name, _)| name);
    let width = REACTION.width(name);
    let time = deadline.map_or(0.0, |text| REACTION.width(text) + 22.0);
    let x = middle.x + POINT / 4.0 - (width + time) / 2.0;
    text(at(x + width / 2.0, middle.y), name, (REACTION, INK), shapes);
    if let Some(deadline) = deadline {
        let clock = at(x + width + 10.0, middle.y + 1.0);
        let d = disc(clock, 4.6);
        let stroke = Some(thin(INK));
        shapes.push(Shape::Path { d, fill: Some(WHITE), stroke });
        let hands = [at(clock.x, clock.y - 3.0), clock, at(clock.x + 2.0, clock.y)];
        shapes.push(Shape::Path { d: line(&hands), fill: None, stroke });
        let button = [at(clock.x, clock.y - 4.6), at(clock.x, clock.y - 6.8)];
        let stroke = Some(Stroke { width: 1.8, ..thin(INK) });
        shapes.push(Shape::Path { d: line(&button), fill: None, stroke });
        let left = x + width + 17.0;
        text(
            at(left + REACTION.width(deadline) / 2.0, middle.y),
            deadline,
            (REACTION, INK),
            shapes,
        );
    }
}

/// A port, and its name.
pub(crate) fn port(port: &Port, shapes: &mut Vec<Shape>) {
    let Rect { x, y, w, h } = port.rect;
    let at = |x, y| Point { x, y };
    let color = if port.red { RED } else { INK };
    let inward = port.direction == Direction::Input;
    let corners = match (port.side, inward) {
        (Side::West, true) | (Side::East, false) => {
            [at(x, y), at(x + w, y + h / 2.0), at(x, y + h)]
        }
        (Side::West, false) | (Side::East, true) => {
            [at(x + w, y), at(x, y + h / 2.0), at(x + w, y + h)]
        }
        (Side::North, true) | (Side::South, false) => {
            [at(x, y), at(x + w / 2.0, y + h), at(x + w, y)]
        }
        (Side::North, false) | (Side::South, true) => {
            [at(x, y + h), at(x + w / 2.0, y), at(x + w, y + h)]
        }
    };
    let (d, fill) = match port.shape {
        PortShape::Hidden => return,
        PortShape::Bar => {
            let (left, right) = (x + w / 2.0 - 2.0, x + w / 2.0 + 2.0);
            (
                polygon(&[
                    at(left, y - 2.0),
                    at(right, y - 2.0),
                    at(right, y + h + 2.0),
                    at(left, y + h + 2.0),
                ]),
                color,
            )
        }
        PortShape::Single => (polygon(&corners), color),
        PortShape::Multi => (polygon(&corners), WHITE),
    };
    let stroke =
        Stroke { width: if port.shape == PortShape::Multi { 1.6 } else { 1.0 }, ..thin(color) };
    shapes.push(Shape::Path { d, fill: Some(fill), stroke: Some(stroke) });
    if let Some(label) = port.label {
        let color = if port.red { RED } else { FAINT };
        text(label.center(), &port.name, (SMALL, color), shapes);
    }
}

/// The corners of a line that reaches the symbols: they are smaller than the space of their nodes.
pub(crate) fn reaching(graph: &Graph, edge: &Edge) -> Vec<Point> {
    let mut points = edge.points.clone();
    // In ELK, a symbol is as wide as what is written below it; what leads into a reaction ends in its notch.
    let inset = |node: &Node| match &node.kind {
        Kind::Reaction { .. } => (node.rect.w - symbol(node).x) / 2.0,
        Kind::Timer | Kind::Startup | Kind::Shutdown | Kind::Reset => {
            (node.rect.w - symbol(node).x) / 2.0
        }
        // In the middle of its height, a triangle is half as wide.
        Kind::Action { .. } => (node.rect.w - symbol(node).x / 2.0) / 2.0,
        Kind::Reactor(_) | Kind::Modes | Kind::Mode { .. } => 0.0,
    };
    let (from, to) = (&graph.nodes[edge.from.0], &graph.nodes[edge.to.0]);
    points[0].x -= inset(from);
    if let Some(last) = points.last_mut() {
        last.x += inset(to);
        if matches!(to.kind, Kind::Reaction { .. }) {
            last.x += POINT;
        }
    }
    points
}

/// What a line ends with, if it does not end at a port that shows the direction.
pub(crate) fn head(graph: &Graph, edge: &Edge, color: Color, shapes: &mut Vec<Shape>) {
    let points = reaching(graph, edge);
    let EdgeKind::Transition { history } = edge.kind else { return };
    let Some([before, end]) = points.last_chunk::<2>().copied() else { return };
    let (dx, dy) = ((end.x - before.x).signum(), (end.y - before.y).signum());
    let (dx, dy) =
        if (end.x - before.x).abs() > (end.y - before.y).abs() { (dx, 0.0) } else { (0.0, dy) };
    let at = |back: f64, aside: f64| Point {
        x: end.x - dx * back - dy * aside,
        y: end.y - dy * back + dx * aside,
    };
    let d = polygon(&[at(0.0, 0.0), at(8.0, 4.0), at(8.0, -4.0)]);
    shapes.push(Shape::Path { d, fill: Some(color), stroke: Some(thin(color)) });
    if history {
        let middle = at(16.0, 0.0);
        shapes.push(Shape::Path {
            d: disc(middle, 6.5),
            fill: Some(WHITE),
            stroke: Some(thin(color)),
        });
        text(middle, "H", (Style { size: 9.0, ..REACTION }, color), shapes);
    }
}

/// The sign of a physical connection, in the middle of its line.
pub(crate) fn squiggle(middle: Point) -> Vec<Point> {
    let at = |x: f64, y: f64| Point { x: middle.x + x, y: middle.y + y };
    vec![at(-11.0, 0.0), at(-7.0, -5.0), at(-2.5, 5.0), at(2.5, -5.0), at(7.0, 5.0), at(11.0, 0.0)]
}

/// A cloud around that point.
pub(crate) fn cloud(middle: Point, scale: f64) -> String {
    let at = |x: f64, y: f64| Point { x: middle.x + x * scale, y: middle.y + y * scale };
    Path::default()
        .to('M', &[at(-6.0, 5.0)])
        .to('C', &[at(-10.5, 5.0), at(-10.5, -1.0), at(-6.0, -1.0)])
        .to('C', &[at(-6.0, -6.5), at(1.5, -7.5), at(3.0, -3.0)])
        .to('C', &[at(6.5, -4.5), at(8.0, -0.5), at(7.0, 0.5)])
        .to('C', &[at(10.0, 1.0), at(9.5, 5.0), at(6.5, 5.0)])
        .close()
}
