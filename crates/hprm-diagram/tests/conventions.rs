//! What a program has, its diagram has: signs, attributes, modes, and causality loops in red.

use hprm_diagram::graph::{EdgeKind, Graph, Kind, PortShape, Side};
use hprm_diagram::{build, layout, page, png, svg};
use hprm_model::outline::Outline;

fn outline(text: &str) -> Outline {
    let mut read = |_: &str| Ok(format!("target Python\n{text}"));
    match hprm_lf::draw("Main.lf", &[], &mut read) {
        Ok(compiled) => compiled.outline.expect("it was asked for"),
        Err(failure) => *failure.outline.clone().unwrap_or_else(|| panic!("{failure}")),
    }
}

fn drawn(text: &str) -> Graph {
    let mut graph = build(&outline(text), &|_| true);
    layout(&mut graph).expect("there is a layout");
    graph
}

fn captions(graph: &Graph) -> Vec<&str> {
    graph.nodes.iter().flat_map(|node| &node.captions).map(|it| it.text.as_str()).collect()
}

#[test]
fn attributes_are_obeyed() {
    let graph = drawn(
        "@label(\"joins\") @layout(option=\"elk.direction\", value=\"DOWN\")
         reactor Join { @side(\"north\") input[4] xs  output y
           @label(\"slow\") reaction(xs) -> y {= pass =} }
         reactor Camera { output image  input back  @label(\"ticks\") timer t(0, 1 s)
           reaction(t) -> image {= pass =} }
         main reactor { cameras = new[4] Camera()  @label(\"all of them\") join = new Join()
           cameras.image -> join.xs
           @label(\"back\") (join.y)+ ~> cameras.back after 5 ms }",
    );
    let captions = captions(&graph);
    for text in ["all of them", "slow", "ticks", "(0, 1 s)"] {
        assert!(captions.contains(&text), "{captions:?}");
    }
    let join = graph.nodes.iter().find(|node| node.title.first().is_some_and(|it| it.0 == "join"));
    let join = join.expect("it is drawn");
    assert_eq!((join.ports[0].side, join.ports[0].shape), (Side::North, PortShape::Multi));
    assert!((join.ports[0].rect.bottom() - join.rect.y).abs() < 0.1);
    assert_eq!(join.ports[0].name, "xs[4]");
    let physical = graph
        .edges
        .iter()
        .find(|edge| edge.kind == EdgeKind::Connection { physical: true, wide: true });
    assert_eq!(physical.expect("it is drawn").label, ["after 5 ms", "back"]);
}

#[test]
fn a_port_without_a_line_from_outside_has_a_place_wherever_the_program_wants_it() {
    for (side, port) in [("north", "input"), ("south", "input"), ("north", "output")] {
        let reaction = if port == "input" { "reaction(p)" } else { "reaction(startup) -> p" };
        let graph = drawn(&format!(
            "reactor B {{ @side(\"{side}\") {port} p  {reaction} {{= pass =}} }}
             main reactor {{ b = new B() }}"
        ));
        let b = graph.nodes.iter().find(|node| !node.ports.is_empty()).expect("it is drawn");
        assert!(!matches!(b.ports[0].side, Side::North | Side::South), "{side}");
    }
}

#[test]
fn a_long_text_is_cut_and_a_viewer_shows_all_of_it() {
    let all = "what the camera saw < the last time it was asked for a picture";
    let graph =
        drawn(&format!("main reactor {{ @label(\"{all}\") timer t  reaction(t) {{= pass =}} }}"));
    let text = svg(&graph, &|_| None);
    let begin = "what the camera saw &lt; the last time it was aske…";
    let whole = format!("{begin}<title>{}</title></text>", all.replace('<', "&lt;"));
    assert!(text.contains(&whole), "{text}");
    assert_eq!(text.matches("</title></text>").count(), 1);
}

#[test]
fn an_option_that_the_layout_does_not_know_is_left_out() {
    let program = |value: &str| {
        format!(
            "@layout(option=\"elk.spacing.nodeNode\", value=\"{value}\")
             main reactor {{ timer t  reaction(t) {{= pass =}}  reaction(startup) {{= pass =}} }}"
        )
    };
    let plain = drawn(&program("18"));
    assert_eq!(drawn(&program("far away")).size, plain.size);
    assert_eq!(drawn(&program("1e308")).size, plain.size);
    assert!(drawn(&program("90")).size.y > plain.size.y);
}

#[test]
fn modes_are_boxes_and_transitions_are_lines_with_their_triggers() {
    let graph = drawn(
        "reactor Machine { input go  output done
           initial mode Idle { reaction(go) -> reset(Busy) {= pass =} }
           mode Busy { timer t(1 ms)  reaction(t) -> done, history(Idle) {= pass =} } }
         main reactor { m = new Machine()  reaction(startup) -> m.go {= pass =} }",
    );
    let initial: Vec<bool> = graph
        .nodes
        .iter()
        .filter_map(|node| match node.kind {
            Kind::Mode { initial } => Some(initial),
            _ => None,
        })
        .collect();
    assert_eq!(initial, [true, false]);
    let transitions: Vec<_> = graph
        .edges
        .iter()
        .filter_map(|edge| match edge.kind {
            EdgeKind::Transition { history } => Some((history, edge.label.join(" "))),
            _ => None,
        })
        .collect();
    assert_eq!(transitions, [(false, "go".to_owned()), (true, "t".to_owned())]);
    let bars = graph.nodes.iter().flat_map(|node| &node.ports);
    assert_eq!(bars.filter(|port| port.shape == PortShape::Bar).count(), 2);
}

#[test]
fn a_causality_loop_is_red_and_the_rest_is_not() {
    let graph = drawn(
        "reactor Node { input x  output y  reaction(x) -> y {= pass =} }
         main reactor { a = new Node()  b = new Node()  c = new Node()
           a.y -> b.x, c.x
           b.y -> a.x }"
            .replace("a.y -> b.x, c.x", "a.y -> b.x\n a.y -> c.x")
            .as_str(),
    );
    let reactions = graph.nodes.iter().filter(|node| matches!(node.kind, Kind::Reaction { .. }));
    let red: Vec<bool> = reactions.map(|node| node.red).collect();
    assert_eq!(red, [true, true, false]);
    let connections =
        graph.edges.iter().filter(|edge| matches!(edge.kind, EdgeKind::Connection { .. }));
    let red: Vec<bool> = connections.map(|edge| edge.red).collect();
    assert_eq!(red, [true, false, true]);
}

#[test]
fn a_loop_through_the_order_of_reactions_shows_that_order() {
    let graph = drawn(
        "reactor Node { input x  output y
           reaction(x) {= pass =}  reaction(startup) -> y {= pass =} }
         main reactor { a = new Node()  a.y -> a.x }",
    );
    let order: Vec<bool> = graph
        .edges
        .iter()
        .filter(|edge| edge.kind == EdgeKind::Order)
        .map(|edge| edge.red)
        .collect();
    assert_eq!(order, [true]);
}

#[test]
fn a_federation_shows_its_coordination_hosts_and_waits() {
    let graph = drawn(
        "reactor A { output y  reaction(startup) -> y {= pass =} }
         reactor B { input y  reaction(y) {= pass =} }
         federated reactor at rti.local { a = new A() at robot.local
           @maxwait(20 ms) @transient b = new B()
           @absent_after(5 ms) a.y -> b.y }",
    );
    let captions = captions(&graph);
    let expected = [
        "centralized coordination",
        "RTI at rti.local",
        "robot.local",
        "transient",
        "maxwait: 20 ms",
    ];
    for text in expected {
        assert!(captions.contains(&text), "{text} is not in {captions:?}");
    }
    assert!(graph.edges.iter().any(|edge| edge.label == ["absent_after: 5 ms"]));
}

#[test]
fn text_of_the_program_stays_text() {
    let program = "@label(\"</script><b>&\") main reactor { reaction(startup) {= pass =} }";
    let outline = outline(program);
    let mut graph = build(&outline, &|_| true);
    layout(&mut graph).expect("there is a layout");
    assert!(svg(&graph, &|_| None).contains("&lt;/script&gt;&lt;b&gt;&amp;"));
    let page = page(&outline, &|_| None, None).expect("there is a page");
    assert_eq!(page.matches("</script>").count(), 2, "the page's own");
}

#[test]
fn a_page_of_a_small_program_has_all_states_and_one_of_a_large_one_those_of_each_reactor() {
    let program = |count: usize| {
        let instances: Vec<String> = (0..count).map(|it| format!("a{it} = new A()")).collect();
        format!(
            "reactor A {{ reaction(startup) {{= pass =}} }}\nmain reactor {{ {} }}",
            instances.join("\n")
        )
    };
    let states = |count: usize| {
        let page = page(&outline(&program(count)), &|_| None, None).expect("there is a page");
        page.matches("{\"open\":[").count() + page.matches(",\"open\":[").count()
    };
    assert_eq!([states(0), states(1), states(3), states(6)], [1, 2, 8, 64]);
    // All closed, all open, and each one open.
    assert_eq!(states(20), 22);
}

#[test]
fn a_png_file_is_one() {
    let graph = drawn("main reactor { reaction(startup) {= pass =} }");
    assert!(png(&graph, 1.0).expect("it is small").starts_with(b"\x89PNG"));
}
