//! Ending the process while code of the program still runs, and may hold the interpreter: none of its exit
//! handlers can run. What HPRM itself would leave behind is removed.

use crate::stage;

/// Ends the process.
pub(crate) fn end(code: i32) -> ! {
    stage::remove_all();
    signal_hook::low_level::exit(code)
}
