//! Where the loop of an agent and the shipping service of its machine meet, which are threads of one process: links
//! that the service wants, and those that others open to it. Each is a [`Pipe`].

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};

use super::pipe::Pipe;
use crate::notifier::Notifier;

/// The agent's side.
#[derive(Debug)]
pub struct ShippingDock {
    wanted: Receiver<String>,
    mark: Notifier,
    service: Arc<Service>,
}

/// A link to another machine that the service wants. If this is dropped without an answer, that is one, too.
#[derive(Debug)]
pub struct WantedLink {
    /// The other machine.
    pub machine: String,
    service: Option<Arc<Service>>,
}

/// The service's side.
#[derive(Debug)]
pub(super) struct Harbor {
    wants: Sender<String>,
    agent: Notifier,
    news: Receiver<News>,
    mark: Notifier,
}

/// What the agent tells the service.
#[derive(Debug)]
pub(super) enum News {
    /// The service wanted a link to that machine.
    Opened(String, io::Result<Pipe>),
    /// Another machine has opened one.
    Came(Pipe),
}

/// Where news go.
#[derive(Debug)]
struct Service {
    news: Sender<News>,
    mark: Notifier,
}

/// Both sides.
///
/// # Errors
///
/// If there are no descriptors.
pub(super) fn dock() -> io::Result<(ShippingDock, Harbor)> {
    let ((wants, wanted), (sender, news)) = (channel(), channel());
    let (agent, mark) = (Notifier::new()?, Notifier::new()?);
    let service = Arc::new(Service { news: sender, mark: mark.clone() });
    let harbor = Harbor { wants, agent: agent.clone(), news, mark };
    Ok((ShippingDock { wanted, mark: agent, service }, harbor))
}

impl ShippingDock {
    /// The links that the service wants now.
    pub fn wanted(&self) -> Vec<WantedLink> {
        self.mark.clear();
        let service = || Some(Arc::clone(&self.service));
        self.wanted.try_iter().map(|machine| WantedLink { machine, service: service() }).collect()
    }

    /// Hands a link to the service that another machine has opened. Returns whether there is a service.
    pub fn hand_over(&self, link: Pipe) -> bool {
        self.service.tell(News::Came(link))
    }
}

impl AsFd for ShippingDock {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.mark.as_fd()
    }
}

impl WantedLink {
    /// The link is open, or why it is not.
    pub fn answer(mut self, opened: io::Result<Pipe>) {
        self.tell(opened);
    }

    fn tell(&mut self, opened: io::Result<Pipe>) {
        if let Some(service) = self.service.take() {
            // Without a service, nothing is shipped.
            service.tell(News::Opened(std::mem::take(&mut self.machine), opened));
        }
    }
}

impl Drop for WantedLink {
    fn drop(&mut self) {
        self.tell(Err(io::ErrorKind::ConnectionReset.into()));
    }
}

impl Service {
    fn tell(&self, news: News) -> bool {
        let is_there = self.news.send(news).is_ok();
        self.mark.notify();
        is_there
    }
}

impl Harbor {
    /// Has the agent open a link to a machine; [`News::Opened`] is the answer, unless the agent ends.
    pub(super) fn want(&self, machine: &str) {
        // Without an agent, the service ends in its next turn.
        let _ = self.wants.send(machine.to_owned());
        self.agent.notify();
    }

    /// Takes the mark that there are news.
    pub(super) fn acknowledge(&self) {
        self.mark.clear();
    }

    /// The next news, if there are some.
    ///
    /// # Errors
    ///
    /// If the agent has ended.
    pub(super) fn next(&self) -> io::Result<Option<News>> {
        match self.news.try_recv() {
            Ok(news) => Ok(Some(news)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }
}

impl AsFd for Harbor {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.mark.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wanted_link_has_one_answer_even_if_it_is_forgotten() {
        let (dock, harbor) = dock().unwrap();
        harbor.want("there");
        harbor.want("elsewhere");
        let [one, other] = <[WantedLink; 2]>::try_from(dock.wanted()).unwrap();
        assert_eq!((one.machine.as_str(), other.machine.as_str()), ("there", "elsewhere"));
        assert!(dock.wanted().is_empty() && harbor.next().unwrap().is_none());
        drop(one);
        let (mine, theirs) = Pipe::pair().unwrap();
        other.answer(Ok(theirs));
        let forgotten = harbor.next().unwrap();
        assert!(matches!(forgotten, Some(News::Opened(it, Err(_))) if it == "there"));
        let opened = harbor.next().unwrap();
        assert!(matches!(opened, Some(News::Opened(it, Ok(_))) if it == "elsewhere"));
        assert!(harbor.next().unwrap().is_none());
        assert!(dock.hand_over(mine));
        assert!(matches!(harbor.next().unwrap(), Some(News::Came(_))));
        drop(dock);
        assert_eq!(harbor.next().unwrap_err().kind(), io::ErrorKind::BrokenPipe);
    }

    #[test]
    fn without_a_service_nothing_is_handed_over() {
        let (dock, harbor) = dock().unwrap();
        drop(harbor);
        assert!(!dock.hand_over(Pipe::pair().unwrap().0));
    }
}
