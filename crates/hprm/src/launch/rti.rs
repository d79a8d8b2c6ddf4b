//! The RTI of a federation that this process launches: a thread, with an address that only this federation
//! knows.

use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{self, JoinHandle};

use super::Launch;
use crate::recorder::TraceRequest;
use crate::supervisor::Observation;
use crate::{Address, Failure, Rti, RtiHandle, RtiOptions, enter_realtime, random_bytes};

/// An RTI that runs until this is dropped.
#[derive(Debug)]
pub(super) struct RtiThread {
    handle: RtiHandle,
    address: Address,
    thread: Option<JoinHandle<()>>,
}

impl RtiThread {
    /// Starts the RTI. What becomes of it is reported to `events`.
    ///
    /// # Errors
    ///
    /// If it cannot be started, or does not get the priority that the program asks for.
    pub(super) fn start(
        launch: &Launch,
        events: SyncSender<Observation>,
        request: Option<&TraceRequest>,
    ) -> Result<Self, Failure> {
        let options = RtiOptions {
            program: Arc::clone(&launch.program),
            fingerprint: Arc::clone(&launch.fingerprint),
            federation: launch.federation,
            listen: private_address()?,
            also_listen: launch.also_listen.clone(),
            security: launch.security.clone(),
            hang_timeout: launch.hang_timeout,
        };
        let rti = Rti::bind(&options)?.recorded(request)?;
        let (handle, address) = (rti.handle(), rti.address().clone());
        let (entered, is_entered) = sync_channel(1);
        let program = options.program;
        let run = move || {
            let allowed = enter_realtime(&program.properties, None);
            let refused = allowed.is_err();
            if entered.send(allowed).is_err() || refused {
                return;
            }
            let outcome = rti.run(|event| drop(events.send(Observation::Rti(event))));
            drop(events.send(Observation::RtiEnded(outcome)));
        };
        let thread = thread::Builder::new()
            .name("rti".to_owned())
            .spawn(run)
            .map_err(|error| Failure::command(format!("cannot start the RTI: {error}")))?;
        // Before any federate is started, which would be refused the same.
        is_entered.recv().expect("the thread says so first of all")?;
        Ok(Self { handle, address, thread: Some(thread) })
    }

    pub(super) fn handle(&self) -> &RtiHandle {
        &self.handle
    }

    /// Where it listens.
    pub(super) fn address(&self) -> &Address {
        &self.address
    }
}

impl Drop for RtiThread {
    fn drop(&mut self) {
        self.handle.abort();
        if let Some(thread) = self.thread.take() {
            // A panic has been shown.
            let _ = thread.join();
        }
    }
}

/// Every user of the machine can see the name of a socket, so it must not contain the secret.
fn private_address() -> Result<Address, Failure> {
    let name = u64::from_ne_bytes(random_bytes()?);
    Ok(format!("unix:@hprm-{name:016x}-rti").parse().expect("an abstract name is an address"))
}
