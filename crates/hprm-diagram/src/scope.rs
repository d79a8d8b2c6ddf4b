//! The boxes of one reactor between which lines lead: its own, and those of its modes.

use std::collections::BTreeMap;

/// The scopes of a reactor, and what is in them so far.
#[derive(Debug)]
pub(crate) struct Scopes {
    /// The node of the reactor.
    pub(crate) reactor: usize,
    /// The node around the modes, if there are any.
    pub(crate) around: Option<usize>,
    /// The nodes of the modes.
    pub(crate) modes: Vec<usize>,
    /// What triggers reactions, by the scope in which it is drawn.
    pub(crate) symbols: BTreeMap<(Symbol, usize), usize>,
    /// The nodes of the reactions.
    pub(crate) reactions: Vec<usize>,
}

/// What triggers a reaction and is no port.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) enum Symbol {
    Startup,
    Shutdown,
    Reset,
    Timer(usize),
    Action(usize),
}

/// An end of a line: a port of a node, and the scope in which it is reached.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) node: usize,
    pub(crate) port: usize,
    pub(crate) scope: usize,
}

impl Scopes {
    pub(crate) fn new(reactor: usize) -> Self {
        let (modes, reactions) = (Vec::new(), Vec::new());
        Self { reactor, around: None, modes, symbols: BTreeMap::new(), reactions }
    }

    /// The node that has what is declared in this mode, or in none.
    pub(crate) fn of_mode(&self, mode: Option<usize>) -> usize {
        mode.map_or(self.reactor, |mode| self.modes[mode])
    }
}
