//! Federations with real sockets and real memory, but in one process and without Python. These tests are one program:
//! linking several takes longer than all of them run.

mod boards;
mod common;
mod direct_links;
mod federation;
#[cfg(feature = "tls")]
mod tls;
mod unauthenticated;
mod value_exchange;
