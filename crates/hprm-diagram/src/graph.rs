//! What a diagram is made of: boxes within boxes, their ports, and the edges between them.
//!
//! [`build`](crate::build) makes it of an outline, [`layout`](crate::layout) gives everything a place.

use hprm_core::Direction;

use crate::text::Style;

/// The text of titles, and of other parts.
pub const TITLE: Style = Style { size: 13.0, bold: true };
/// The class of an instance, beside its name.
pub const CLASS: Style = Style { size: 13.0, bold: false };
/// Names of ports, timers and actions, and what stands below them.
pub const SMALL: Style = Style { size: 11.0, bold: false };
/// What stands in a reaction.
pub const REACTION: Style = Style { size: 11.0, bold: true };

/// A point, in pixels.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Point {
    /// To the right.
    pub x: f64,
    /// Down.
    pub y: f64,
}

/// A rectangle, in pixels.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Rect {
    /// Its left edge.
    pub x: f64,
    /// Its upper edge.
    pub y: f64,
    /// Its width.
    pub w: f64,
    /// Its height.
    pub h: f64,
}

impl Rect {
    /// The right edge.
    #[must_use]
    pub fn right(self) -> f64 {
        self.x + self.w
    }

    /// The lower edge.
    #[must_use]
    pub fn bottom(self) -> f64 {
        self.y + self.h
    }

    /// The middle.
    #[must_use]
    pub fn center(self) -> Point {
        Point { x: self.x + self.w / 2.0, y: self.y + self.h / 2.0 }
    }
}

/// A diagram; the first node is the main reactor.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Graph {
    /// The boxes, a container before its contents.
    pub nodes: Vec<Node>,
    /// The lines.
    pub edges: Vec<Edge>,
    /// The size of the picture.
    pub size: Point,
}

/// A box, or a symbol with what is written below it.
#[derive(Clone, PartialEq, Debug)]
pub struct Node {
    /// What it is.
    pub kind: Kind,
    /// The node around it.
    pub parent: Option<usize>,
    /// What is written at its top, in a row.
    pub title: Vec<(String, Style)>,
    /// What is written below the title of a reactor, or below a symbol.
    pub captions: Vec<Caption>,
    /// Its ports.
    pub ports: Vec<Port>,
    /// Options of the layout that the program states.
    pub layout: Vec<(String, String)>,
    /// The picture beside its title, as the program names it.
    pub icon: Option<String>,
    /// Whether it is part of a causality loop.
    pub red: bool,
    /// Where it is; of a symbol, with its captions.
    pub rect: Rect,
    /// Where the title of a box is, with all below it.
    pub heading: Option<Rect>,
    /// Where the width of a bank is.
    pub width: Option<Rect>,
}

/// What a node is.
#[derive(Clone, PartialEq, Debug)]
pub enum Kind {
    /// A reactor.
    Reactor(Reactor),
    /// A reaction.
    Reaction {
        /// How late it may begin, as text.
        deadline: Option<String>,
    },
    /// A timer.
    Timer,
    /// An action.
    Action {
        /// Whether its events get the physical time.
        physical: bool,
    },
    /// The start of the program.
    Startup,
    /// Its end.
    Shutdown,
    /// The entry of a mode that resets it.
    Reset,
    /// What is around the modes of a reactor.
    Modes,
    /// A mode.
    Mode {
        /// Whether the reactor starts in it.
        initial: bool,
    },
}

/// A reactor, or a bank of them.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Reactor {
    /// Its index in the outline.
    pub index: usize,
    /// Whether its contents are drawn.
    pub open: bool,
    /// Whether it has contents.
    pub opens: bool,
    /// Whether it has a sign that says whether it is open.
    pub sign: bool,
    /// The width of a bank.
    pub bank: Option<u32>,
    /// Whether it is a federation.
    pub federated: bool,
    /// Whether it is a transient federate.
    pub transient: bool,
}

/// A line of text below a title or a symbol.
#[derive(Clone, PartialEq, Debug)]
pub struct Caption {
    /// What it says.
    pub text: String,
    /// What it is.
    pub kind: CaptionKind,
}

/// What a line of text is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CaptionKind {
    /// A name or a time.
    Plain,
    /// A remark, in a box of its own.
    Note,
    /// Where a federate runs.
    Host,
}

/// A port.
#[derive(Clone, PartialEq, Debug)]
pub struct Port {
    /// Its name; empty if it is none that users see.
    pub name: String,
    /// Input or output.
    pub direction: Direction,
    /// Which side of its node it is on.
    pub side: Side,
    /// How it looks.
    pub shape: PortShape,
    /// Whether it is part of a causality loop.
    pub red: bool,
    /// Where it is.
    pub rect: Rect,
    /// Where its name is.
    pub label: Option<Rect>,
}

/// A side of a node.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Side {
    /// Above.
    North,
    /// To the right.
    East,
    /// Below.
    South,
    /// To the left.
    West,
}

/// How a port looks.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PortShape {
    /// A triangle.
    Single,
    /// An empty triangle.
    Multi,
    /// A bar, where lines enter what is around modes.
    Bar,
    /// Nothing: lines just end there.
    Hidden,
}

/// A line between two ports.
#[derive(Clone, PartialEq, Debug)]
pub struct Edge {
    /// The node that contains it.
    pub container: usize,
    /// Where it begins: a node, and its port.
    pub from: (usize, usize),
    /// Where it ends.
    pub to: (usize, usize),
    /// What it is.
    pub kind: EdgeKind,
    /// What is written on it, line by line.
    pub label: Vec<String>,
    /// Whether it is part of a causality loop.
    pub red: bool,
    /// Where its label is.
    pub label_rect: Option<Rect>,
    /// Its corners, from its begin to its end.
    pub points: Vec<Point>,
}

/// What a line is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum EdgeKind {
    /// A connection.
    Connection {
        /// Whether messages get the physical time.
        physical: bool,
        /// Whether it has several channels.
        wide: bool,
    },
    /// What a reaction depends on, or what depends on it.
    Dependency,
    /// That a reaction comes before another one of its reactor.
    Order,
    /// A transition from one mode to another one.
    Transition {
        /// Whether the mode continues where it was left.
        history: bool,
    },
}

impl Node {
    /// A node without a title, without ports, and without a place.
    pub(crate) fn new(kind: Kind, parent: Option<usize>) -> Self {
        Self {
            kind,
            parent,
            title: Vec::new(),
            captions: Vec::new(),
            ports: Vec::new(),
            layout: Vec::new(),
            icon: None,
            red: false,
            rect: Rect::default(),
            heading: None,
            width: None,
        }
    }

    /// Whether other nodes can be in it.
    #[must_use]
    pub fn is_container(&self) -> bool {
        match &self.kind {
            Kind::Reactor(reactor) => reactor.open,
            Kind::Modes | Kind::Mode { .. } => true,
            _ => false,
        }
    }

    /// Whether it is a box with a title at its top.
    #[must_use]
    pub fn is_box(&self) -> bool {
        matches!(self.kind, Kind::Reactor(_) | Kind::Modes | Kind::Mode { .. })
    }

    /// The index of the port of that name, of reactors and modes.
    pub(crate) fn port(&self, name: &str) -> Option<usize> {
        self.ports.iter().position(|port| port.name == name)
    }
}

impl Port {
    /// A port whose name is not written.
    pub(crate) fn hidden(direction: Direction) -> Self {
        Self {
            name: String::new(),
            direction,
            side: Side::of(direction),
            shape: PortShape::Hidden,
            red: false,
            rect: Rect::default(),
            label: None,
        }
    }
}

impl Side {
    /// Where ports of that direction are, if the program does not say it.
    pub(crate) fn of(direction: Direction) -> Self {
        match direction {
            Direction::Input => Self::West,
            Direction::Output => Self::East,
        }
    }

    /// Whether it is above or below.
    pub(crate) fn is_vertical(self) -> bool {
        matches!(self, Self::North | Self::South)
    }

    /// The side of that name.
    pub(crate) fn named(name: &str) -> Option<Self> {
        match name {
            "north" => Some(Self::North),
            "east" => Some(Self::East),
            "south" => Some(Self::South),
            "west" => Some(Self::West),
            _ => None,
        }
    }

    /// What the layout calls it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::North => "NORTH",
            Self::East => "EAST",
            Self::South => "SOUTH",
            Self::West => "WEST",
        }
    }
}
