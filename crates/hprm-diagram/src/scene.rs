//! What a diagram with places looks like: shapes, one above the other.
//!
//! `symbol` has the shapes of single parts.

use crate::graph::{CaptionKind, Edge, EdgeKind, Graph, Kind, Node, Point, Reactor, Rect, SMALL};
use crate::layout::{COPIES, ICON_SPACE, bank, caption_rects};
use crate::shape::{Color, Dash, Shape, Stroke, line, rounded, rounded_line};
use crate::symbol;
use crate::text::Style;

pub(crate) const WHITE: Color = Color(0xff_ff_ff);
pub(crate) const INK: Color = Color(0x1f_23_28);
pub(crate) const LINE: Color = Color(0x3d_44_4d);
pub(crate) const FAINT: Color = Color(0x59_63_6e);
pub(crate) const RED: Color = Color(0xd1_24_2f);
const BORDER: Color = Color(0x9a_a4_af);
const REACTOR: Color = Color(0xf1_f3_f5);
const MODES: Color = Color(0xfa_fb_fc);
const MODE: Color = Color(0xe2_e8_f0);
const MODE_BORDER: Color = Color(0x70_80_90);
const TRANSIENT: Color = Color(0x00_64_00);
const NOTE: Color = Color(0xff_f8_e1);
const NOTE_BORDER: Color = Color(0xda_a5_20);

/// The radius of the corners of boxes, and of lines.
const CORNER: f64 = 8.0;
const BEND: f64 = 4.0;

/// All shapes of a diagram, from the back to the front.
pub(crate) fn scene(graph: &Graph) -> Vec<Shape> {
    let mut scene =
        Scene { graph, inside: vec![Vec::new(); graph.nodes.len()], shapes: Vec::new() };
    for (index, node) in graph.nodes.iter().enumerate() {
        if let Some(parent) = node.parent {
            scene.inside[parent].push(index);
        }
    }
    if !graph.nodes.is_empty() {
        scene.node(0, 0);
    }
    scene.shapes
}

struct Scene<'a> {
    graph: &'a Graph,
    /// By node, what it contains.
    inside: Vec<Vec<usize>>,
    shapes: Vec<Shape>,
}

impl<'a> Scene<'a> {
    fn path(&mut self, d: String, fill: Option<Color>, stroke: Option<Stroke>) {
        self.shapes.push(Shape::Path { d, fill, stroke });
    }

    fn node(&mut self, index: usize, depth: usize) {
        let graph: &'a Graph = self.graph;
        let node = &graph.nodes[index];
        let reactor = match &node.kind {
            Kind::Reactor(reactor) => Some(reactor),
            _ => None,
        };
        if let Some(reactor) = reactor {
            let (index, opens, open) = (reactor.index, reactor.opens, reactor.open);
            self.shapes.push(Shape::Begin { reactor: index, opens, open });
        }
        let fill = fill(node, depth);
        if node.is_box() {
            self.boxed(node, fill);
        } else {
            symbol::draw(node, &mut self.shapes);
            self.captions(node);
        }
        let edges: Vec<&'a Edge> =
            graph.edges.iter().filter(|edge| edge.container == index).collect();
        // Red lines are not hidden below others.
        for edge in edges.iter().filter(|edge| !edge.red) {
            self.edge(edge);
        }
        for edge in edges.iter().filter(|edge| edge.red) {
            self.edge(edge);
        }
        for child in self.inside[index].clone() {
            self.node(child, depth + 1);
        }
        for edge in &edges {
            self.label(edge, fill);
        }
        for port in &node.ports {
            symbol::port(port, &mut self.shapes);
        }
        // A line to a port above may lead through the sign's place.
        if let Some(Reactor { sign: true, open, .. }) = reactor {
            let middle = Point { x: node.rect.right() - 14.0, y: node.rect.y + 14.0 };
            self.shapes.push(Shape::Sign { middle, open: *open });
        }
        if reactor.is_some() {
            self.shapes.push(Shape::End);
        }
    }

    fn boxed(&mut self, node: &Node, fill: Color) {
        let (border, width) = match &node.kind {
            Kind::Reactor(reactor) if reactor.transient => (TRANSIENT, 1.5),
            Kind::Mode { initial: true } => (MODE_BORDER, 3.0),
            Kind::Mode { initial: false } => (MODE_BORDER, 1.5),
            _ if node.red => (RED, 1.5),
            _ => (BORDER, 1.0),
        };
        let dash = if node.kind == Kind::Modes { Dash::Dashed } else { Dash::Solid };
        let stroke = Stroke { color: border, width, dash };
        if let Some(width) = bank(node) {
            let copies = f64::from(width.clamp(2, 4) - 1);
            for copy in (1..width.clamp(2, 4)).rev().map(f64::from) {
                let (x, y) = (COPIES.x * copy / copies, COPIES.y * copy / copies);
                let rect = Rect { x: node.rect.x + x, y: node.rect.y + y, ..node.rect };
                self.path(rounded(rect, CORNER), Some(fill), Some(stroke));
            }
        }
        let d = rounded(node.rect, CORNER);
        self.shapes.push(Shape::Frame { d, fill, stroke });
        if let Some(heading) = node.heading {
            self.title(node, heading);
        }
        self.captions(node);
        if let (Some(rect), Some(width)) = (node.width, bank(node)) {
            self.text(rect.center(), &format!("×{width}"), SMALL, FAINT);
        }
    }

    fn title(&mut self, node: &Node, heading: Rect) {
        let Some((_, style)) = node.title.first() else { return };
        let width = crate::build::title_width(node);
        let cloud = matches!(&node.kind, Kind::Reactor(reactor) if reactor.federated);
        let signs = f64::from(u8::from(cloud) + u8::from(node.icon.is_some()));
        let y = heading.y + style.line() / 2.0;
        let mut x = heading.center().x - (width + signs * ICON_SPACE) / 2.0;
        if let Some(icon) = &node.icon {
            self.shapes.push(Shape::Image { at: Point { x, y: y - 9.0 }, name: icon.clone() });
            x += ICON_SPACE;
        }
        if cloud {
            self.path(
                symbol::cloud(Point { x: x + 9.0, y }, 1.0),
                Some(WHITE),
                Some(symbol::thin(FAINT)),
            );
            x += ICON_SPACE;
        }
        for (text, style) in &node.title {
            let width = style.width(text);
            self.text(Point { x: x + width / 2.0, y }, text, *style, INK);
            x += width;
        }
    }

    fn captions(&mut self, node: &Node) {
        for (caption, rect) in node.captions.iter().zip(caption_rects(node)) {
            let width = SMALL.width(&caption.text);
            let middle = rect.center();
            match caption.kind {
                CaptionKind::Plain => self.text(middle, &caption.text, SMALL, FAINT),
                CaptionKind::Host => {
                    let left = Point { x: middle.x - width / 2.0, y: middle.y };
                    self.path(symbol::cloud(left, 0.72), Some(WHITE), Some(symbol::thin(FAINT)));
                    self.text(Point { x: middle.x + 9.0, ..middle }, &caption.text, SMALL, FAINT);
                }
                CaptionKind::Note => {
                    let w = width + 12.0;
                    let note = Rect { x: middle.x - w / 2.0, y: rect.y + 3.0, w, h: rect.h - 4.0 };
                    let border = symbol::thin(NOTE_BORDER);
                    self.path(rounded(note, 3.0), Some(NOTE), Some(border));
                    self.text(note.center(), &caption.text, SMALL, INK);
                }
            }
        }
    }

    fn edge(&mut self, edge: &Edge) {
        if edge.points.len() < 2 {
            return;
        }
        let color = if edge.red { RED } else { LINE };
        let (width, dash) = match edge.kind {
            EdgeKind::Connection { wide: true, .. } => (2.2, Dash::Solid),
            EdgeKind::Connection { wide: false, .. } => (1.2, Dash::Solid),
            EdgeKind::Dependency => (1.0, Dash::Dashed),
            EdgeKind::Order => (1.0, Dash::Dotted),
            EdgeKind::Transition { .. } => (1.2, Dash::Solid),
        };
        let width = if edge.red { width + 0.6 } else { width };
        let points = symbol::reaching(self.graph, edge);
        let stroke = Stroke { color, width, dash };
        let bend =
            if matches!(edge.kind, EdgeKind::Transition { .. }) { 2.0 * CORNER } else { BEND };
        self.path(rounded_line(&points, bend), None, Some(stroke));
        symbol::head(self.graph, edge, color, &mut self.shapes);
    }

    /// What is on a line, above what the line crosses.
    fn label(&mut self, edge: &Edge, background: Color) {
        let Some(rect) = edge.label_rect else { return };
        let back = Rect { x: rect.x, y: rect.y + 1.0, h: rect.h - 2.0, ..rect };
        self.path(rounded(back, 3.0), Some(background), None);
        let color = if edge.red { RED } else { LINE };
        let mut y = rect.y + 1.0;
        if matches!(edge.kind, EdgeKind::Connection { physical: true, .. }) {
            let middle = Point { x: rect.center().x, y: y + SMALL.line() / 2.0 };
            let stroke = Stroke { color, width: 1.2, dash: Dash::Solid };
            self.path(line(&symbol::squiggle(middle)), None, Some(stroke));
            y += SMALL.line();
        }
        for text in &edge.label {
            let middle = Point { x: rect.center().x, y: y + SMALL.line() / 2.0 };
            self.text(middle, text, SMALL, if edge.red { RED } else { FAINT });
            y += SMALL.line();
        }
    }

    fn text(&mut self, middle: Point, text: &str, style: Style, color: Color) {
        symbol::text(middle, text, (style, color), &mut self.shapes);
    }
}

/// What a box is filled with.
fn fill(node: &Node, depth: usize) -> Color {
    match &node.kind {
        Kind::Mode { .. } => MODE,
        Kind::Modes => MODES,
        _ if depth.is_multiple_of(2) => WHITE,
        _ => REACTOR,
    }
}
