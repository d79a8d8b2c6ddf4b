//! Which frames a log has: the words of the variable, and what they select.

use hprm_core::Program;
use hprm_federated::Frame;

use super::Party;

/// The word that stands for all frames, and the one that stands for the RTI.
const ALL: &str = "all";
const RTI: &str = "rti";

/// Frames to and from certain federates, and of certain kinds. Where none is named, all are meant.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(super) struct Filter {
    parties: Vec<Party>,
    kinds: Vec<&'static str>,
}

impl Filter {
    /// What a text selects; or else the first word that names nothing.
    pub(super) fn of(text: &str, program: &Program) -> Result<Self, String> {
        let mut filter = Self::default();
        for word in text.split(',').map(str::trim) {
            if word == ALL {
                continue;
            }
            let kind = Frame::KINDS.iter().find(|kind| kind.eq_ignore_ascii_case(word));
            let parties = parties(word, program);
            match kind {
                Some(kind) => filter.kinds.push(kind),
                None if parties.is_empty() => return Err(word.to_owned()),
                None => filter.parties.extend(parties),
            }
        }
        Ok(filter)
    }

    /// Whether the log has a frame between these two.
    pub(super) fn takes(&self, ends: &[Party; 2], frame: &Frame) -> bool {
        let is_meant = self.parties.is_empty() || ends.iter().any(|end| self.parties.contains(end));
        is_meant && (self.kinds.is_empty() || self.kinds.contains(&frame.name()))
    }
}

/// What a word names: the RTI, a federate, or all members of a bank of federates.
fn parties(word: &str, program: &Program) -> Vec<Party> {
    if word == RTI {
        return vec![Party::Rti];
    }
    program.federates_meant(word).map(Party::Federate).collect()
}

#[cfg(test)]
mod tests {
    use hprm_core::{FederateId, Tag};

    use super::*;
    use crate::frame_log::line::tests::two_federates;

    #[test]
    fn words_select_by_federate_and_by_kind() {
        let program = two_federates();
        let [camera, detector] = [0, 1].map(|id| Party::Federate(FederateId(id)));
        let grant = Frame::TagAdvanceGrant { tag: Tag::START };
        let takes = |text: &str, ends: [Party; 2], frame: &Frame| {
            Filter::of(text, &program).expect(text).takes(&ends, frame)
        };
        assert!(takes("all", [camera, Party::Rti], &grant));
        assert!(takes("camera", [camera, Party::Rti], &grant));
        assert!(takes("camera", [detector, camera], &grant));
        assert!(!takes("camera", [detector, Party::Rti], &grant));
        assert!(takes("rti", [Party::Rti, Party::Unknown], &grant));
        assert!(takes("message, tagadvancegrant", [camera, Party::Rti], &grant));
        assert!(!takes("Message", [camera, Party::Rti], &grant));
        assert!(!takes("detector,TagAdvanceGrant", [camera, Party::Rti], &grant));
    }

    #[test]
    fn the_word_that_names_nothing_is_told() {
        let program = two_federates();
        for (text, word) in [("camrea", "camrea"), ("camera,,Message", ""), ("NET", "NET")] {
            assert_eq!(Filter::of(text, &program), Err(word.to_owned()), "{text}");
        }
    }
}
