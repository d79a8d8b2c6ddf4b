//! Where queries of other agents are answered: on a thread of its own.
//!
//! Zenoh tells of a query on the thread that reads all connections, and with TLS writes them as well (`threads.rs`). An answer
//! waits until there is room for it; on that thread it would wait for itself. Nothing would come or leave for five
//! seconds, and then Zenoh would close the connection, with all links of that way on it.
//!
//! When nothing holds a query any more, Zenoh tells that no more answers come, which waits for room as well. Zenoh itself
//! holds the query a moment after it has told of it, and would be the last where the answer is given sooner. So this
//! thread holds each query for a while after it was answered.

use std::any::Any;
use std::collections::VecDeque;
use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// How many answers may wait; more are dropped, and the other agent asks again. As many queries are held.
const ANSWERS: usize = 1024;

/// How long a query is held after its answer: longer than Zenoh holds it, however busy the machine is.
const HELD: Duration = Duration::from_secs(1);

/// Answers a query, and is the query from then on.
type Answer = Box<dyn FnOnce() -> Box<dyn Any> + Send>;

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

    /// Has a query answered soon; never waits.
    pub(crate) fn give<Q: Send + 'static>(
        &self,
        query: Q,
        answer: impl FnOnce(&Q) + Send + 'static,
    ) {
        let answered = move || {
            answer(&query);
            Box::new(query) as Box<dyn Any>
        };
        drop(self.0.try_send(Box::new(answered)));
    }
}

fn give(answers: &Receiver<Answer>) {
    let mut held = VecDeque::new();
    loop {
        let now = Instant::now();
        while held.front().is_some_and(|(until, _)| *until <= now) || held.len() > ANSWERS {
            held.pop_front();
        }
        let next = match held.front() {
            Some((until, _)) => answers.recv_timeout(*until - now),
            None => answers.recv().map_err(RecvTimeoutError::from),
        };
        match next {
            Ok(answer) => held.push_back((Instant::now() + HELD, answer())),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Sender, channel};

    use super::*;

    /// A query that tells when nothing holds it any more.
    struct Query(u32, Sender<u32>);

    impl Drop for Query {
        fn drop(&mut self) {
            let _ = self.1.send(self.0);
        }
    }

    #[test]
    fn answers_are_given_in_order_and_one_that_waits_holds_up_no_caller() {
        let replies = Replies::open().unwrap();
        let (go, gone) = channel::<()>();
        let (begin, begun) = channel();
        let (said, heard) = channel();
        replies.give((), move |()| {
            begin.send(()).unwrap();
            let _ = gone.recv();
        });
        begun.recv().unwrap();
        for number in 0..2 * ANSWERS {
            let said = said.clone();
            replies.give(number, move |number| said.send(*number).unwrap());
        }
        drop((go, said));
        let heard: Vec<_> = heard.iter().collect();
        assert!(heard.into_iter().eq(0..ANSWERS));
    }

    #[test]
    fn a_query_is_held_after_its_answer_and_some_only_of_many() {
        let replies = Replies::open().unwrap();
        let (ends, ended) = channel();
        let (said, heard) = channel();
        let answer = |number: u32| {
            let said = said.clone();
            let answered = move |query: &Query| said.send(query.0).unwrap();
            replies.give(Query(number, ends.clone()), answered);
            assert_eq!(heard.recv(), Ok(number));
        };
        let many = u32::try_from(ANSWERS).unwrap();
        let began = Instant::now();
        (0..many).for_each(answer);
        let are_held = ended.try_recv().is_err();
        // On a machine that is so busy, the first ones are not held any more.
        assert!(are_held || began.elapsed() >= HELD);
        (many..2 * many).for_each(answer);
        let first: Vec<_> = (1..many).map(|_| ended.recv().unwrap()).collect();
        assert!(first.into_iter().eq(0..many - 1));
        let last: Vec<_> = (0..=many).map(|_| ended.recv().unwrap()).collect();
        assert!(last.into_iter().eq(many - 1..2 * many));
        assert!(began.elapsed() >= HELD);
    }
}
