//! Every program of the tests and of the examples has a diagram in which nothing overlaps.

use std::fs;
use std::path::{Path, PathBuf};

use hprm_diagram::graph::{Graph, Node, Point, PortShape, Rect};
use hprm_diagram::{build, layout};
use hprm_model::outline::Outline;

/// What is said to be beside each other may touch.
const TOLERANCE: f64 = 0.05;

fn files_below(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{folder:?}: {error}"));
    for entry in entries {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files_below(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "lf") {
            found.push(path);
        }
    }
}

/// All programs in `.lf` files that can be drawn, with their names.
fn programs() -> Vec<(String, Outline)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut files = Vec::new();
    for folder in ["tests", "examples", "bench", "docs"] {
        files_below(&root.join(folder), &mut files);
    }
    files.sort();
    let outline = |path: PathBuf| {
        let mut read = |path: &str| fs::read_to_string(path).map_err(|error| error.to_string());
        let name = path.to_str()?;
        let drawn = match hprm_lf::draw(name, &[], &mut read) {
            Ok(compiled) => compiled.outline,
            Err(failure) => failure.outline.map(|outline| *outline),
        };
        Some((name.to_owned(), drawn?))
    };
    files.into_iter().filter_map(outline).collect()
}

fn drawn(outline: &Outline, open: &dyn Fn(usize) -> bool) -> Graph {
    let mut graph = build(outline, open);
    layout(&mut graph).expect("there is a layout");
    graph
}

#[test]
fn nothing_overlaps_in_the_diagrams_of_all_programs() {
    let programs = programs();
    assert!(programs.len() > 60, "only {} programs", programs.len());
    let mut wrong = Vec::new();
    for (name, outline) in &programs {
        for (state, open) in [("open", true), ("closed", false)] {
            let graph = drawn(outline, &|reactor| open || reactor == 0);
            let found = mistakes(&graph);
            wrong.extend(found.into_iter().map(|what| format!("{name} ({state}): {what}")));
        }
    }
    assert!(wrong.is_empty(), "{} mistakes:\n{}", wrong.len(), wrong.join("\n"));
}

/// Everything in a diagram that a person would not have drawn.
fn mistakes(graph: &Graph) -> Vec<String> {
    let mut wrong = Vec::new();
    boxes(graph, &mut wrong);
    labels(graph, &mut wrong);
    lines(graph, &mut wrong);
    wrong
}

/// Boxes are within what contains them, and siblings do not intersect.
fn boxes(graph: &Graph, wrong: &mut Vec<String>) {
    let whole = Rect { x: 0.0, y: 0.0, w: graph.size.x, h: graph.size.y };
    for (index, node) in graph.nodes.iter().enumerate() {
        let around = node.parent.map_or(whole, |parent| graph.nodes[parent].rect);
        if !contains(around, node.rect) {
            wrong.push(format!("{} leaves what contains it", name(graph, index)));
        }
        for (other, sibling) in graph.nodes.iter().enumerate().skip(index + 1) {
            if sibling.parent == node.parent && intersect(node.rect, sibling.rect) {
                wrong.push(format!("{} overlaps {}", name(graph, index), name(graph, other)));
            }
        }
    }
}

/// Labels in boxes are within them; those beside ports and on lines are on nothing else.
fn labels(graph: &Graph, wrong: &mut Vec<String>) {
    let mut placed: Vec<(usize, String, Rect)> = Vec::new();
    for (index, node) in graph.nodes.iter().enumerate() {
        for label in node.heading.iter().chain(&node.width) {
            if !contains(node.rect, *label) {
                wrong.push(format!("the title of {} leaves it", name(graph, index)));
            }
            placed.push((index, format!("the title of {}", name(graph, index)), *label));
        }
        for port in &node.ports {
            let Some(label) = port.label else { continue };
            let what = format!("the name of {}.{}", name(graph, index), port.name);
            if node.is_container() {
                let outside = node.parent.unwrap_or(index);
                placed.push((outside, what, label));
            } else {
                if !contains(node.rect, label) {
                    wrong.push(format!("{what} leaves its box"));
                }
                placed.push((index, what, label));
            }
        }
    }
    for edge in &graph.edges {
        if let Some(label) = edge.label_rect {
            placed.push((edge.container, format!("the label {:?}", edge.label), label));
        }
    }
    for (at, (scope, what, rect)) in placed.iter().enumerate() {
        for (_, other, beside) in placed.iter().skip(at + 1).filter(|(it, ..)| it == scope) {
            if intersect(*rect, *beside) {
                wrong.push(format!("{what} overlaps {other}"));
            }
        }
        let inside = graph.nodes.iter().enumerate().filter(|(_, it)| it.parent == Some(*scope));
        for (index, node) in inside {
            if intersect(*rect, node.rect) {
                wrong.push(format!("{what} is on {}", name(graph, index)));
            }
        }
    }
}

/// Lines end at ports, and pass through no box that they have nothing to do with.
fn lines(graph: &Graph, wrong: &mut Vec<String>) {
    for (number, edge) in graph.edges.iter().enumerate() {
        let (from, to) = (edge.from.0, edge.to.0);
        let what = format!("the line {number} from {} to {}", name(graph, from), name(graph, to));
        let (Some(first), Some(last)) = (edge.points.first(), edge.points.last()) else {
            wrong.push(format!("{what} has no place"));
            continue;
        };
        for (end, (node, port)) in [(first, edge.from), (last, edge.to)] {
            let port = &graph.nodes[node].ports[port];
            if !touches(port.rect, *end) {
                wrong.push(format!("{what} ends at {end:?}, not at its port {:?}", port.rect));
            }
        }
        for pair in edge.points.windows(2) {
            if (pair[0].x - pair[1].x).abs() > TOLERANCE
                && (pair[0].y - pair[1].y).abs() > TOLERANCE
            {
                wrong.push(format!("{what} is not at right angles"));
            }
            for (index, node) in graph.nodes.iter().enumerate() {
                // Whatever is inside a sibling is crossed only with it.
                let is_sibling = node.parent == Some(edge.container);
                if is_sibling && crosses(node.rect, pair[0], pair[1]) {
                    wrong.push(format!("{what} passes through {}", name(graph, index)));
                }
            }
            let around = graph.nodes[edge.container].rect;
            let outside = |point: Point| !touches(around, point);
            let leads_out = [from, to].contains(&edge.container);
            if !leads_out && (outside(pair[0]) || outside(pair[1])) {
                wrong.push(format!("{what} leaves {}", name(graph, edge.container)));
            }
        }
    }
}

fn name(graph: &Graph, index: usize) -> String {
    let node: &Node = &graph.nodes[index];
    let text = node.title.first().map(|(text, _)| text.as_str());
    let text = text.or(node.captions.first().map(|caption| caption.text.as_str()));
    format!("{index} {}", text.unwrap_or("without a name"))
}

fn contains(outer: Rect, inner: Rect) -> bool {
    inner.x >= outer.x - TOLERANCE
        && inner.y >= outer.y - TOLERANCE
        && inner.right() <= outer.right() + TOLERANCE
        && inner.bottom() <= outer.bottom() + TOLERANCE
}

fn intersect(a: Rect, b: Rect) -> bool {
    a.x < b.right() - TOLERANCE
        && b.x < a.right() - TOLERANCE
        && a.y < b.bottom() - TOLERANCE
        && b.y < a.bottom() - TOLERANCE
}

fn touches(rect: Rect, point: Point) -> bool {
    contains(rect, Rect { x: point.x, y: point.y, w: 0.0, h: 0.0 })
}

/// Whether a line that is horizontal or vertical goes through the inside of a rectangle.
fn crosses(rect: Rect, a: Point, b: Point) -> bool {
    let line = Rect {
        x: a.x.min(b.x),
        y: a.y.min(b.y),
        w: (a.x - b.x).abs().max(4.0 * TOLERANCE),
        h: (a.y - b.y).abs().max(4.0 * TOLERANCE),
    };
    intersect(rect, line)
}

#[test]
fn a_diagram_is_the_same_each_time() {
    for (name, outline) in programs().iter().take(10) {
        let svg = || hprm_diagram::svg(&drawn(outline, &|_| true), &|_| None);
        assert_eq!(svg(), svg(), "{name}");
    }
}

#[test]
fn ports_that_users_see_have_names() {
    for (program, outline) in programs() {
        let graph = drawn(&outline, &|_| true);
        for node in &graph.nodes {
            for port in node.ports.iter().filter(|port| port.shape != PortShape::Hidden) {
                assert!(!port.name.is_empty(), "{program}");
            }
        }
    }
}
