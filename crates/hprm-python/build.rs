//! Tells the compiler for which Python this is: `Py_GIL_DISABLED` where threads run without a global lock.

fn main() {
    pyo3_build_config::use_pyo3_cfgs();
}
