//! Sources come and go between waits; closed descriptors leave their numbers to others.

use std::os::fd::AsFd;

use rustix::event::{EventfdFlags, eventfd};
use rustix::io::{dup, dup2, read, write};

use super::*;
use crate::wait::Interest;

const NOW: Option<PhysicalTime> = Some(PhysicalTime(0));

/// A descriptor, and what identifies it.
struct Opened(OwnedFd, SourceId);

impl Opened {
    fn new() -> Self {
        Self(eventfd(0, EventfdFlags::NONBLOCK).unwrap(), SourceId::new())
    }

    fn source(&self, write: bool) -> Source<'_> {
        Source::new(self.1, Interest { fd: self.0.as_fd(), write })
    }

    fn signal(&self) {
        write(&self.0, &1_u64.to_ne_bytes()).unwrap();
    }

    fn clear(&self) {
        read(&self.0, &mut [0; 8]).unwrap();
    }
}

/// Which of the descriptors can be read.
fn readable(set: &mut EpollSet, opened: &[&Opened]) -> Vec<bool> {
    let sources: Vec<_> = opened.iter().map(|it| it.source(false)).collect();
    set.wait(&sources, NOW).into_iter().map(Ready::can_be_read).collect()
}

#[test]
fn all_that_are_ready_are_reported_in_their_order() {
    for mut set in [EpollSet::Empty, EpollSet::Unavailable] {
        let opened: Vec<_> = (0..40).map(|_| Opened::new()).collect();
        let all: Vec<_> = opened.iter().collect();
        assert_eq!(readable(&mut set, &all), vec![false; 40]);
        let odd: Vec<_> = (0..40).map(|at| at % 2 == 1).collect();
        all.iter().zip(&odd).filter(|(_, odd)| **odd).for_each(|(it, _)| it.signal());
        assert_eq!(readable(&mut set, &all), odd);
        // It is reported until it is read.
        assert_eq!(readable(&mut set, &all), odd);
        all[1].clear();
        assert!(!readable(&mut set, &all)[1]);
        let turned: Vec<_> = opened.iter().rev().collect();
        assert_eq!(readable(&mut set, &turned).iter().filter(|it| **it).count(), 19);
    }
}

#[test]
fn a_number_that_is_used_again_belongs_to_another_source() {
    let mut set = EpollSet::Empty;
    let (kept, mut old) = (Opened::new(), Opened::new());
    assert_eq!(readable(&mut set, &[&kept, &old]), [false, false]);
    let number = old.0.as_raw_fd();
    // Closes the old one in the same step: between two steps, the number could go to a test beside this one.
    let mut new = Opened::new();
    dup2(&new.0, &mut old.0).unwrap();
    std::mem::swap(&mut new.0, &mut old.0);
    drop(old);
    assert_eq!(new.0.as_raw_fd(), number);
    new.signal();
    assert_eq!(readable(&mut set, &[&kept, &new]), [false, true]);
}

#[test]
fn a_closed_descriptor_that_another_process_keeps_open_is_not_reported() {
    let mut set = EpollSet::Empty;
    let (kept, old) = (Opened::new(), Opened::new());
    assert_eq!(readable(&mut set, &[&kept, &old]), [false, false]);
    // As after a fork.
    let other = Opened(dup(&old.0).unwrap(), SourceId::new());
    drop(old);
    other.signal();
    assert_eq!(readable(&mut set, &[&kept]), [false]);
    let sources = [kept.source(false)];
    let before = crate::Clock::now();
    set.wait(&sources, Some(before.plus(2_000_000)));
    assert!(crate::Clock::now().since(before) >= 2_000_000, "the wait has lasted to its end");
}

#[test]
fn what_is_waited_for_can_change() {
    for mut set in [EpollSet::Empty, EpollSet::Unavailable] {
        let opened = Opened::new();
        for write in [false, true, false, true] {
            let ready = set.wait(&[opened.source(write)], NOW)[0];
            assert_eq!((ready.can_be_read(), ready.can_be_written()), (false, write));
        }
    }
}

#[test]
fn without_epoll_the_descriptors_are_polled() {
    // A file cannot be waited for with epoll.
    let file = std::fs::File::open("/proc/self/exe").unwrap();
    let source = Source::new(SourceId::new(), Interest { fd: file.as_fd(), write: false });
    let mut set = EpollSet::Empty;
    assert!(set.wait(&[source], NOW)[0].can_be_read());
    assert!(matches!(set, EpollSet::Unavailable));
    assert!(set.wait(&[source], NOW)[0].can_be_read());
}

#[test]
fn a_notifier_is_ready_once_for_each_notification_and_need_not_be_read() {
    let mut set = EpollSet::Empty;
    let (notifier, other) = (Opened::new(), Opened::new());
    let mut ready = |write| {
        let sources = [Source::notifier(notifier.1, notifier.0.as_fd()), other.source(write)];
        set.wait(&sources, NOW)[0].can_be_read()
    };
    assert!(!ready(false));
    for _ in 0..3 {
        notifier.signal();
        assert!(ready(false) && !ready(false));
    }
    // What else is waited for makes no difference.
    assert!(!ready(true) && !ready(false));
    notifier.signal();
    notifier.signal();
    assert!(ready(true) && !ready(true));
    assert!(set.tells_once());
    assert!(!EpollSet::Unavailable.tells_once());
}
