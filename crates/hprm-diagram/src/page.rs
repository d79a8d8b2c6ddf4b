//! Diagrams as HTML pages that need nothing else: reactors open and close, the picture moves and grows.
//!
//! A page has no layout of its own: it has the picture of each state that it can show. Of a small program these are all
//! states; of a large one those in which all reactors down to a depth are open, and those in which one is.

use std::collections::BTreeSet;

use hprm_model::outline::Outline;
use serde_json::{Value, json};

use crate::build::{build, has_contents};
use crate::graph::Kind;
use crate::layout::{NoLayout, layout};
use crate::svg::{body, escaped};

/// The most reactors that open of which a page has all states.
const FEW: usize = 6;
/// The most states, and the most bytes of their pictures, apart from the first ones.
const MOST_STATES: usize = 150;
const MOST_BYTES: usize = 8_000_000;
/// The most parts of a diagram that a page begins with.
const MOST_PARTS: usize = 120;

/// What is often in pictures, in whose place pages have characters that no text has (`escaped`).
const SHORT: [&str; 9] = [
    " lengthAdjust=\"spacingAndGlyphs\" xml:space=\"preserve\">",
    " text-anchor=\"middle\" font-size=\"",
    "\" stroke-width=\"1\" stroke-linejoin=\"round\"",
    " stroke-linejoin=\"round\"",
    "\" stroke-width=\"",
    "\" fill=\"#",
    "\" stroke=\"#",
    " textLength=\"",
    "<path d=\"M",
];

static TEMPLATE: &str = include_str!("templates/page.html");

/// The reactors that are open, the main reactor apart.
type State = BTreeSet<usize>;

/// The page; `images` gives the pictures that the program names, and `depth` is how deep reactors are open at first.
///
/// # Errors
///
/// [`NoLayout`] if the program cannot be drawn.
pub fn page(
    outline: &Outline,
    images: &dyn Fn(&str) -> Option<String>,
    depth: Option<u32>,
) -> Result<String, NoLayout> {
    let tree = Tree::of(outline);
    let mut bytes = 0;
    let mut pictures = Vec::new();
    let mut parts_of_all = 0;
    for (number, state) in tree.states().into_iter().enumerate() {
        if number > tree.depth && bytes > MOST_BYTES {
            break;
        }
        let (parts, picture) = picture(outline, &state, images)?;
        parts_of_all = parts_of_all.max(parts);
        bytes += picture["svg"].as_str().map_or(0, str::len);
        pictures.push((state, picture));
    }
    let begin = match depth {
        Some(depth) => tree.level(depth as usize),
        None if parts_of_all <= MOST_PARTS => tree.level(usize::MAX),
        None => tree.level(1),
    };
    let begin = pictures.iter().position(|(state, _)| *state == begin).unwrap_or_default();
    let pictures: Vec<Value> = pictures.into_iter().map(|(_, picture)| picture).collect();
    let parents: Vec<Value> = outline
        .reactors
        .iter()
        .map(|reactor| reactor.parent.map_or(Value::Null, Value::from))
        .collect();
    let names: Vec<&str> = outline.reactors.iter().map(|reactor| &*reactor.name).collect();
    let data = json!({ "begin": begin, "states": pictures, "parents": parents, "names": names, "short": SHORT });
    // Nothing in the data can end the element that contains it.
    let data = data.to_string().replace('<', "\\u003c");
    let name = outline.reactors.first().map_or("", |main| &main.name);
    Ok(TEMPLATE.replace("{{name}}", &escaped(name)).replace("{{data}}", &data))
}

fn picture(
    outline: &Outline,
    state: &State,
    images: &dyn Fn(&str) -> Option<String>,
) -> Result<(usize, Value), NoLayout> {
    let mut graph = build(outline, &|reactor| reactor == 0 || state.contains(&reactor));
    for node in graph.nodes.iter_mut().skip(1) {
        if let Kind::Reactor(reactor) = &mut node.kind {
            reactor.sign = reactor.opens;
        }
    }
    layout(&mut graph)?;
    let open: Vec<usize> = state.iter().copied().collect();
    let picture = json!({
        "open": open,
        "width": graph.size.x,
        "height": graph.size.y,
        "svg": shortened(body(&graph, images)),
    });
    Ok((graph.nodes.len(), picture))
}

fn shortened(picture: String) -> String {
    let replaced = |text: String, (sign, long): (char, &str)| text.replace(long, &sign.to_string());
    let signs = ('\u{e000}'..).zip(SHORT);
    signs.fold(picture, replaced)
}

/// The reactors that open.
struct Tree<'a> {
    outline: &'a Outline,
    reactors: Vec<usize>,
    /// How deep the deepest of them is.
    depth: usize,
}

impl<'a> Tree<'a> {
    fn of(outline: &'a Outline) -> Self {
        let reactors: Vec<usize> =
            (1..outline.reactors.len()).filter(|index| has_contents(outline, *index)).collect();
        let mut tree = Self { outline, reactors, depth: 0 };
        tree.depth = tree.reactors.iter().map(|it| tree.around(*it).len()).max().unwrap_or(0);
        tree
    }

    /// The reactors that contain this one, and itself, without the main reactor.
    fn around(&self, reactor: usize) -> State {
        let parent = |index: &usize| self.outline.reactors[*index].parent;
        std::iter::successors(Some(reactor), parent).filter(|index| *index != 0).collect()
    }

    /// All reactors that are at most this deep.
    fn level(&self, depth: usize) -> State {
        let open = |index: &&usize| self.around(**index).len() < depth;
        self.reactors.iter().filter(open).copied().collect()
    }

    /// The states that a page has, those by depth first.
    fn states(&self) -> Vec<State> {
        let mut states: Vec<State> = (1..=self.depth + 1).map(|depth| self.level(depth)).collect();
        let mut known: BTreeSet<State> = states.iter().cloned().collect();
        let more: Vec<State> = if self.reactors.len() <= FEW {
            (0..1_usize << self.reactors.len()).map(|bits| self.subset(bits)).collect()
        } else {
            self.reactors.iter().map(|reactor| self.around(*reactor)).collect()
        };
        for state in more {
            let is_whole = state.iter().all(|it| self.around(*it).is_subset(&state));
            if is_whole && states.len() < MOST_STATES && known.insert(state.clone()) {
                states.push(state);
            }
        }
        states
    }

    fn subset(&self, bits: usize) -> State {
        let chosen = self.reactors.iter().enumerate().filter(|(at, _)| bits & (1 << at) != 0);
        chosen.map(|(_, reactor)| *reactor).collect()
    }
}
