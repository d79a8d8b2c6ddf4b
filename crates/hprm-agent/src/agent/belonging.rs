//! What an agent does when the roster changes, or its certificate: Zenoh has both from when a session is opened, so it opens another one.
//!
//! Links outlive that, as they outlive a network that breaks for a moment; those to machines that were taken out end.

use std::sync::atomic::Ordering;

use hprm::Clock;
use hprm::agent::Answer;
use hprm_federated::relay::Input;

use super::Agent;
use crate::Failure;
use crate::credentials::{Credentials, lifetime_of, renew_due};
use crate::membership::News;
use crate::options::Options;
use crate::telling::tell;

impl Agent {
    /// Takes what another agent says of rosters and certificates.
    pub(super) fn hear(&mut self, news: &News) {
        let Some(membership) = &mut self.membership else { return };
        if let Err(failure) = membership.hear(news) {
            // The others refuse who is not on the roster, too, and the old certificate is valid for a while.
            failure.tell();
        }
    }

    /// Asks others for a newer roster, when it is time, and lives by the one that there is.
    ///
    /// # Errors
    ///
    /// If this machine does not belong to the others any more, or cannot be reached again.
    pub(super) fn belong(&mut self, options: &Options) -> Result<(), Failure> {
        let Some(membership) = &mut self.membership else { return Ok(()) };
        if let Some(before) = membership.look()? {
            self.reopen(options, &before)?;
        }
        let Some(membership) = &mut self.membership else { return Ok(()) };
        if membership.is_to_ask(Clock::local()) {
            self.carrier.ask_for_roster(&membership.credentials);
        }
        if let Some(partner) = membership.rounds.partner(Clock::local(), &self.others.direct()) {
            self.carrier.ask_for_certificates(&partner, &membership.credentials);
        }
        Ok(())
    }

    /// Has the user know of a certificate that ends, once a day; the agent of the authority's user renews those of machines.
    pub(super) fn look_at_ends(&mut self, options: &Options) {
        let now = Clock::local();
        if now < self.daily.next_wakeup() {
            return;
        }
        let credentials = self.membership.as_ref().map(|it| &it.credentials);
        match credentials.map(renew_due).transpose() {
            Ok(renewed) => renewed.flatten().iter().for_each(|told| tell(told)),
            Err(failure) => failure.tell(),
        }
        let own = || lifetime_of(&options.name, options.tls.as_ref()?);
        let lifetime = credentials.map(Credentials::lifetime).or_else(own);
        self.daily.look(now, lifetime.as_ref());
    }

    fn reopen(&mut self, options: &Options, before: &Credentials) -> Result<(), Failure> {
        let Some(membership) = &self.membership else { return Ok(()) };
        let credentials = membership.credentials.clone();
        let now = Clock::local();
        let mut halves = Vec::new();
        for (id, link) in &mut self.links {
            let (machine, roster) = (&id.agent.machine, credentials.roster());
            if roster.has_taken_out(before.roster(), machine) {
                let why = format!("the authority has taken {machine} out of its machines");
                link.handle(now, Input::Abort(why));
            } else if let Some(router) = id.router.as_ref().filter(|it| !roster.is_router(it)) {
                let why = format!("{router} is no router any more, as the authority says");
                link.handle(now, Input::Abort(why));
            } else if link.is_open() {
                link.handle(now, Input::CarrierDown);
            } else {
                halves.push(id.clone());
            }
        }
        // An answer to the old session does not arrive. Who wants such a link tries again.
        for id in halves {
            let why = format!("the agent of {} connects again", self.me.machine);
            self.opened(now, &id, Answer::Absent(why));
        }
        self.others.clear();
        self.rival_since = None;
        self.carrier.reopen(options, &credentials)?;
        self.leads_shipments.store(options.is_router(Some(&credentials)), Ordering::Relaxed);
        let failed = |error| Failure::new(format!("Zenoh fails: {error}"));
        for (id, link) in &mut self.links {
            link.redirect(self.carrier.way(id).map_err(failed)?);
        }
        Ok(())
    }
}
