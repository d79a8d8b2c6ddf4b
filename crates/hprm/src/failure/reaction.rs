//! The failure of a reaction of a program in Rust: the error that its body has returned, with where and when.

use std::error::Error;
use std::fmt::{self, Display};
use std::iter::successors;
use std::sync::Arc;

use hprm_core::Tag;

use super::Report;

/// A body of a reaction has returned an error, which is the [`source`](Error::source) of this one.
#[derive(Clone)]
pub struct ReactionFailure {
    reaction: String,
    tag: Tag,
    error: Arc<dyn Error + Send + Sync>,
}

impl ReactionFailure {
    pub(crate) fn new(reaction: String, tag: Tag, error: Box<dyn Error + Send + Sync>) -> Self {
        Self { reaction, tag, error: error.into() }
    }

    /// The full name of the reaction: its reactor, and its number among the reactions of that.
    #[must_use]
    pub fn reaction(&self) -> &str {
        &self.reaction
    }

    /// The tag at which it ran.
    #[must_use]
    pub fn tag(&self) -> Tag {
        self.tag
    }

    /// The error that the body has returned.
    #[must_use]
    pub fn error(&self) -> &(dyn Error + Send + Sync + 'static) {
        &*self.error
    }

    /// A plain report, with what is known here.
    pub(super) fn report(&self, plain: Report) -> Report {
        let causes =
            successors(self.error.source(), |cause: &&(dyn Error + 'static)| (*cause).source());
        let causes: Vec<_> = causes.map(|cause| format!("caused by: {cause}")).collect();
        Report {
            reaction: Some(self.reaction.clone()),
            tag: Some((self.tag.time, self.tag.microstep)),
            details: (!causes.is_empty()).then(|| causes.join("\n")),
            ..plain
        }
    }
}

impl Display for ReactionFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { reaction, tag, error } = self;
        write!(f, "reaction {reaction} failed at {tag}: {error}")
    }
}

impl fmt::Debug for ReactionFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { reaction, tag, error } = self;
        f.debug_struct("ReactionFailure")
            .field("reaction", reaction)
            .field("tag", tag)
            .field("error", error)
            .finish()
    }
}

impl Error for ReactionFailure {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        Some(&*self.error)
    }
}

impl PartialEq for ReactionFailure {
    /// Errors are compared by what they say.
    fn eq(&self, other: &Self) -> bool {
        self.to_string() == other.to_string()
    }
}

impl Eq for ReactionFailure {}
