//! Ending the process while code of the program still runs, and may hold the interpreter: none of its exit
//! handlers can run. What HPRM itself would leave behind is removed.

use hprm::Report;
use hprm::recorder::cut_recordings;
use hprm::trace::cut_traces;

use crate::console::show;
use crate::{stage, stalls};

/// Ends the process.
pub(crate) fn end(code: i32) -> ! {
    stage::remove_all();
    signal_hook::low_level::exit(code)
}

/// Ends the process of a federate whose federation has ended without it, and says which reactions run.
pub(crate) fn after_failure(report: &Report) {
    stalls::report_all();
    show(report);
    cut_traces();
    cut_recordings();
    end(report.code);
}
