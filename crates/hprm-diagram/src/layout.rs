//! Gives everything in a graph a place: the graph as ELK reads it, and what ELK makes of it.
//!
//! The algorithm is ELK's layered one: what depends on something is to the right of it, lines have right angles, and
//! lines between the same parts share a way. It draws from a seed that is always the same.

use serde_json::{Value, json};

use crate::build::{caption_height, captions_size, title_width};
use crate::graph::{
    Caption, Edge, EdgeKind, Graph, Kind, Node, Point, Port, PortShape, REACTION, Rect, SMALL, Side,
};

/// The size of the symbol of a timer.
pub(crate) const TIMER: f64 = 30.0;
/// The size of other symbols.
pub(crate) const SYMBOL: f64 = 18.0;
/// The height of a reaction, and how far its point is ahead of its edges.
pub(crate) const REACTION_HEIGHT: f64 = 24.0;
pub(crate) const POINT: f64 = 7.0;
/// The size of a port.
pub(crate) const PORT: f64 = 8.0;
/// How far the copies behind a bank reach beyond it.
pub(crate) const COPIES: Point = Point { x: 6.0, y: 9.0 };
/// What is free around the picture.
const MARGIN: f64 = 14.0;
/// The room for the picture beside a title.
pub(crate) const ICON_SPACE: f64 = 24.0;
/// The room beside a title for the sign that says whether a reactor is open, and on its other side.
pub(crate) const SIGN_SPACE: f64 = 16.0;
/// The room for the sign of a delay or a physical connection on a line.
const SIGN: f64 = 22.0;

/// The largest number of an option that a program states, in pixels.
const LARGEST: f64 = 10_000.0;

/// The layout failed: a bug of the layout, or an option that it does not know.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct NoLayout(pub String);

/// Whether an option that the program states, with its value, is used.
type Known<'a> = &'a dyn Fn(&str, &str) -> bool;

/// Places everything. Options that the program states are left out if there is no layout with them.
///
/// # Errors
///
/// [`NoLayout`] if there is no layout without them, either.
pub fn layout(graph: &mut Graph) -> Result<(), NoLayout> {
    let elk = elkrs::create_elk();
    let attempt = |stated: bool| {
        let known = |option: &str, value: &str| {
            let known = elk.options.option_by_suffix(option);
            // A number beyond all pictures overflows.
            let is_large = value.parse::<f64>().is_ok_and(|number| number.abs() > LARGEST);
            stated && !is_large && known.is_some_and(|known| known.parse_value(value).is_some())
        };
        elk.layout_json(&document(graph, &known).to_string())
    };
    let placed = attempt(true).or_else(|_| attempt(false)).map_err(NoLayout)?;
    read(graph, &placed);
    Ok(())
}

/// The graph as ELK reads it.
fn document(graph: &Graph, known: Known<'_>) -> Value {
    json!({
        "id": "root",
        "layoutOptions": {
            "elk.algorithm": "layered",
            "elk.direction": "RIGHT",
            "elk.hierarchyHandling": "INCLUDE_CHILDREN",
            "elk.edgeRouting": "ORTHOGONAL",
            "elk.padding": format!("[top={MARGIN},left={MARGIN},bottom={MARGIN},right={MARGIN}]"),
        },
        "children": [node(graph, 0, known)],
    })
}

fn node(graph: &Graph, index: usize, known: Known<'_>) -> Value {
    let node = &graph.nodes[index];
    let mut options = if node.is_box() { box_options(node) } else { symbol_options() };
    for (option, value) in &node.layout {
        if !option.contains("algorithm") && known(option, value) {
            options[option] = Value::from(value.as_str());
        }
    }
    let size = size(node);
    let ports: Vec<Value> =
        node.ports.iter().enumerate().map(|(at, it)| port(node, (index, at), it, size)).collect();
    let mut described = json!({
        "id": format!("n{index}"),
        "layoutOptions": options,
        "ports": ports,
    });
    if node.is_box() {
        described["labels"] = Value::from(labels(node));
    } else {
        described["width"] = Value::from(size.x);
        described["height"] = Value::from(size.y);
    }
    if node.is_container() {
        let inside = |(_, it): &(usize, &Node)| it.parent == Some(index);
        let children = graph.nodes.iter().enumerate().filter(inside);
        let children: Vec<Value> =
            children.map(|(child, _)| self::node(graph, child, known)).collect();
        let edges = graph.edges.iter().enumerate().filter(|(_, edge)| edge.container == index);
        let edges: Vec<Value> = edges.map(|(at, it)| edge(at, it)).collect();
        described["children"] = Value::from(children);
        described["edges"] = Value::from(edges);
    }
    described
}

fn box_options(node: &Node) -> Value {
    let is_open = node.is_container();
    let lower = if bank(node).is_some() { 20.0 } else { 14.0 };
    let mut options = json!({
        "elk.algorithm": "layered",
        "elk.direction": "RIGHT",
        "elk.edgeRouting": "ORTHOGONAL",
        "elk.portConstraints": "FIXED_SIDE",
        "elk.insideSelfLoops.activate": true,
        "elk.nodeSize.constraints": "[PORTS, PORT_LABELS, NODE_LABELS, MINIMUM_SIZE]",
        "elk.nodeSize.options": "[DEFAULT_MINIMUM_SIZE, ASYMMETRICAL]",
        "elk.nodeSize.minimum": if is_open { "(60,40)" } else { "(70,44)" },
        "elk.nodeLabels.padding": "[top=6,left=10,bottom=4,right=10]",
        "elk.portLabels.placement": if is_open { "[OUTSIDE, ALWAYS_OTHER_SAME_SIDE]" } else { "[INSIDE, NEXT_TO_PORT_IF_POSSIBLE]" },
        "elk.spacing.portPort": 14,
        "elk.spacing.labelPortHorizontal": 3,
        "elk.spacing.labelPortVertical": 2,
        "elk.spacing.portsSurrounding": "[top=8,left=8,bottom=8,right=8]",
        "elk.padding": format!("[top=12,left=16,bottom={lower},right=16]"),
        "elk.spacing.nodeNode": 18,
        "elk.spacing.edgeNode": 12,
        "elk.spacing.edgeEdge": 10,
        "elk.spacing.edgeLabel": 4,
        "elk.spacing.componentComponent": 18,
        "elk.layered.spacing.nodeNodeBetweenLayers": 26,
        "elk.layered.spacing.edgeNodeBetweenLayers": 14,
        "elk.layered.spacing.edgeEdgeBetweenLayers": 10,
        "elk.layered.considerModelOrder.strategy": "PREFER_NODES",
        "elk.layered.nodePlacement.strategy": "NETWORK_SIMPLEX",
        "elk.layered.thoroughness": 20,
        "elk.randomSeed": 1,
    });
    if is_open && node.ports.iter().any(|port| port.side.is_vertical()) {
        // ELK's port cannot place names of such ports; `port` makes room for them.
        options["elk.nodeSize.constraints"] = Value::from("[PORTS, NODE_LABELS, MINIMUM_SIZE]");
    }
    if let Kind::Mode { initial: true } = node.kind {
        options["elk.layered.layering.layerConstraint"] = Value::from("FIRST");
    }
    options
}

fn symbol_options() -> Value {
    json!({ "elk.portConstraints": "FIXED_POS" })
}

/// The width of a bank.
pub(crate) fn bank(node: &Node) -> Option<u32> {
    match &node.kind {
        Kind::Reactor(reactor) => reactor.bank,
        _ => None,
    }
}

/// What is written in a box: at its top the title with all below it, and at its lower left the width of a bank.
fn labels(node: &Node) -> Vec<Value> {
    let mut labels = Vec::new();
    let size = heading(node);
    if size.y > 0.0 {
        labels.push(json!({
            "text": "heading",
            "width": size.x,
            "height": size.y,
            "layoutOptions": { "elk.nodeLabels.placement": "[INSIDE, V_TOP, H_CENTER]" },
        }));
    }
    if let Some(width) = bank(node) {
        labels.push(json!({
            "text": "bank",
            "width": SMALL.width(&format!("×{width}")),
            "height": SMALL.line(),
            "layoutOptions": { "elk.nodeLabels.placement": "[INSIDE, V_BOTTOM, H_LEFT]" },
        }));
    }
    labels
}

/// The size of a title with all below it.
fn heading(node: &Node) -> Point {
    let captions = captions_size(node);
    let title = node.title.first().map_or(0.0, |(_, style)| style.line());
    let cloud = matches!(&node.kind, Kind::Reactor(reactor) if reactor.federated);
    let icons = f64::from(u8::from(node.icon.is_some()) + u8::from(cloud)) * ICON_SPACE;
    let sign = matches!(&node.kind, Kind::Reactor(reactor) if reactor.sign);
    let sign = if sign { 2.0 * SIGN_SPACE } else { 0.0 };
    Point { x: (title_width(node) + icons + sign).max(captions.w), y: title + captions.h }
}

/// The size of a symbol with what is below it; of a box, that of a port at least.
fn size(node: &Node) -> Point {
    let symbol = symbol(node);
    let captions = captions_size(node);
    Point { x: symbol.x.max(captions.w), y: symbol.y + captions.h }
}

/// The size of a symbol.
pub(crate) fn symbol(node: &Node) -> Point {
    match &node.kind {
        Kind::Reaction { deadline } => {
            let deadline = deadline.as_ref().map_or(0.0, |text| REACTION.width(text) + 22.0);
            let w = (title_width(node) + deadline + 2.0 * POINT + 14.0).max(45.0);
            Point { x: w.ceil(), y: REACTION_HEIGHT }
        }
        Kind::Timer => Point { x: TIMER, y: TIMER },
        Kind::Action { .. } | Kind::Startup | Kind::Shutdown | Kind::Reset => {
            Point { x: SYMBOL, y: SYMBOL }
        }
        Kind::Reactor(_) | Kind::Modes | Kind::Mode { .. } => Point::default(),
    }
}

fn port(node: &Node, (of, at): (usize, usize), port: &Port, size: Point) -> Value {
    let mut described = json!({ "id": format!("p{of}_{at}") });
    let options = &mut described["layoutOptions"];
    options["elk.port.side"] = Value::from(port.side.name());
    if node.is_box() {
        let size = if port.shape == PortShape::Hidden { 0.0 } else { PORT };
        described["width"] = Value::from(size);
        described["height"] = Value::from(size);
        if node.is_container() && port.side.is_vertical() {
            described["width"] = Value::from(PORT + 2.0 * name_width(port));
            described["height"] = Value::from(SMALL.line());
        } else if port.shape != PortShape::Hidden && port.shape != PortShape::Bar {
            described["labels"] = json!([{
                "text": port.name,
                "width": SMALL.width(&port.name).ceil(),
                "height": SMALL.line(),
            }]);
        }
        if port.shape == PortShape::Bar {
            described["layoutOptions"]["elk.port.borderOffset"] = Value::from(-PORT / 2.0);
        }
        return described;
    }
    let is_input = port.direction == hprm_core::Direction::Input;
    described["x"] = Value::from(if is_input { 0.0 } else { size.x });
    described["y"] = Value::from(symbol(node).y / 2.0);
    described["width"] = Value::from(0.0);
    described["height"] = Value::from(0.0);
    described
}

fn edge(index: usize, edge: &Edge) -> Value {
    let end = |(node, port): (usize, usize)| format!("p{node}_{port}");
    let mut described = json!({
        "id": format!("e{index}"),
        "sources": [end(edge.from)],
        "targets": [end(edge.to)],
    });
    if edge.from.0 == edge.container && edge.to.0 == edge.container {
        described["layoutOptions"] = json!({ "elk.insideSelfLoops.yo": true });
    }
    let size = label_size(edge);
    if size.x > 0.0 {
        described["labels"] = json!([{
            "text": "label",
            "width": size.x,
            "height": size.y,
            "layoutOptions": { "elk.edgeLabels.inline": true, "elk.edgeLabels.placement": "CENTER" },
        }]);
    }
    described
}

fn is_physical(edge: &Edge) -> bool {
    matches!(edge.kind, EdgeKind::Connection { physical: true, .. })
}

/// The size of what is on a line, with the sign of a physical connection.
fn label_size(edge: &Edge) -> Point {
    let lines = edge.label.iter().map(|line| SMALL.width(line) + 8.0);
    let sign = if is_physical(edge) { SIGN } else { 0.0 };
    let w = lines.fold(sign, f64::max);
    let rows = edge.label.len() + usize::from(is_physical(edge));
    #[expect(clippy::cast_precision_loss, reason = "a label has a few lines")]
    let h = rows as f64 * SMALL.line();
    Point { x: w.ceil(), y: if rows == 0 { 0.0 } else { h + 2.0 } }
}

/// Lines to ports above and below boxes lead through the room of their names to the ports.
fn reach(end: Option<&mut Point>, port: Rect) {
    if let Some(point) = end {
        point.y = point.y.clamp(port.y, port.bottom());
    }
}

/// Takes the places from what ELK has made of the graph.
fn read(graph: &mut Graph, placed: &Value) {
    let whole = rect(placed, Point::default());
    graph.size = Point { x: whole.w, y: whole.h };
    let mut pending = vec![(placed, Point::default())];
    while let Some((node, around)) = pending.pop() {
        // Places are relative to what is around them.
        let own = rect(node, around);
        let own = Point { x: own.x, y: own.y };
        if let Some(index) = number(node).filter(|_| node["id"] != "root") {
            read_node(&mut graph.nodes[index], node, (around, own));
        }
        for edge in list(node, "edges") {
            if let Some(index) = number(edge) {
                read_edge(&mut graph.edges[index], edge, own);
            }
        }
        pending.extend(list(node, "children").iter().map(|child| (child, own)));
    }
    for edge in &mut graph.edges {
        let (from, to) = (edge.from, edge.to);
        let place = |(node, port): (usize, usize)| graph.nodes[node].ports[port].rect;
        reach(edge.points.first_mut(), place(from));
        reach(edge.points.last_mut(), place(to));
    }
}

fn read_node(node: &mut Node, placed: &Value, (around, own): (Point, Point)) {
    node.rect = rect(placed, around);
    let labels = list(placed, "labels").iter();
    for label in labels {
        let place = Some(rect(label, own));
        if label["text"] == "bank" {
            node.width = place;
        } else {
            node.heading = place;
        }
    }
    let is_open = node.is_container();
    for (port, placed) in node.ports.iter_mut().zip(list(placed, "ports")) {
        port.rect = rect(placed, own);
        if is_open && port.side.is_vertical() {
            beside(port);
            continue;
        }
        let corner = Point { x: port.rect.x, y: port.rect.y };
        port.label = list(placed, "labels").first().map(|label| rect(label, corner));
    }
}

/// How much room the name of a port takes that is above or below its box.
fn name_width(port: &Port) -> f64 {
    if port.name.is_empty() { 0.0 } else { SMALL.width(&port.name).ceil() + 4.0 }
}

/// Divides the room of a port above or below a box: the port is in its middle, its name to the right.
fn beside(port: &mut Port) {
    let room = port.rect;
    let y = if port.side == Side::North { room.bottom() - PORT } else { room.y };
    let x = room.center().x - PORT / 2.0;
    port.rect = Rect { x, y, w: PORT, h: PORT };
    let label = Rect { x: x + PORT + 4.0, y: room.y, w: name_width(port) - 4.0, h: room.h };
    port.label = (!port.name.is_empty()).then_some(label);
}

fn read_edge(edge: &mut Edge, placed: &Value, around: Point) {
    let point = |value: &Value| {
        let Rect { x, y, .. } = rect(value, around);
        Point { x, y }
    };
    for section in list(placed, "sections") {
        edge.points.push(point(&section["startPoint"]));
        edge.points.extend(list(section, "bendPoints").iter().map(point));
        edge.points.push(point(&section["endPoint"]));
    }
    // Lines from a box to itself miss the middle of its ports by less than a pixel.
    if let [first, second, .., last_but_one, last] = &mut edge.points[..] {
        for (end, corner) in [(first, second), (last, last_but_one)] {
            if (end.y - corner.y).abs() < 1.0 {
                corner.y = end.y;
            }
        }
    }
    edge.label_rect = list(placed, "labels").first().map(|label| rect(label, around));
}

fn list<'a>(value: &'a Value, name: &str) -> &'a [Value] {
    value[name].as_array().map_or(&[], Vec::as_slice)
}

/// A place that is stated relative to `around`, in hundredths of a pixel, so that the last bit of a number is not in the
/// picture.
fn rect(value: &Value, around: Point) -> Rect {
    let of = |name: &str| value[name].as_f64().unwrap_or_default();
    let round = |value: f64| (value * 100.0).round() / 100.0;
    let (x, y) = (round(around.x + of("x")), round(around.y + of("y")));
    Rect { x, y, w: round(of("width")), h: round(of("height")) }
}

/// The number in `n7` or `e7`.
fn number(value: &Value) -> Option<usize> {
    value["id"].as_str()?.get(1..)?.parse().ok()
}

/// Where the lines below a title or a symbol are.
pub(crate) fn caption_rects(node: &Node) -> Vec<Rect> {
    let around = node.heading.unwrap_or(node.rect);
    let above = match node.title.first() {
        Some((_, style)) if node.is_box() => style.line(),
        _ => symbol(node).y,
    };
    let mut y = around.y + above;
    let place = |caption: &Caption| {
        let h = caption_height(caption);
        let rect = Rect { y, h, ..around };
        y += h;
        rect
    };
    node.captions.iter().map(place).collect()
}
