//! Where queries of other agents are answered: on a thread of its own.
//!
//! Zenoh tells of a query on the thread that reads all connections, and with TLS writes them as well (`threads.rs`). An answer
//! waits until there is room for it; on that thread it would wait for itself. Nothing would come or leave for five
//! seconds, and then Zenoh would close the connection, with all links of that way on it.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

/// How many answers may wait; more are dropped, and the other agent asks again.
const ANSWERS: usize = 1024;

type Answer = Box<dyn FnOnce() + Send>;

/// See the module. The thread ends with the last of these.
#[derive(Clone)]
pub(crate) struct Replies(SyncSender<Answer>);

impl Replies {
    /// Starts the thread.
    pub(crate) fn open() -> io::Result<Self> {
        let (into, answers) = sync_channel(ANSWERS);
        thread::Builder::new().name("replies".to_owned()).spawn(move || give(&answers))?;
        Ok(Self(into))
    }

    /// Has an answer given soon; never waits.
    pub(crate) fn give(&self, answer: impl FnOnce() + Send + 'static) {
        drop(self.0.try_send(Box::new(answer)));
    }
}

fn give(answers: &Receiver<Answer>) {
    for answer in answers {
        answer();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn answers_are_given_in_order_and_one_that_waits_holds_up_no_caller() {
        let replies = Replies::open().unwrap();
        let (go, gone) = channel::<()>();
        let (begin, begun) = channel();
        let (said, heard) = channel();
        replies.give(move || {
            begin.send(()).unwrap();
            let _ = gone.recv();
        });
        begun.recv().unwrap();
        for number in 0..2 * ANSWERS {
            let said = said.clone();
            replies.give(move || said.send(number).unwrap());
        }
        drop((go, said));
        let heard: Vec<_> = heard.iter().collect();
        assert!(heard.into_iter().eq(0..ANSWERS));
    }
}
