//! A socket for records that never waits, and the records for which it has had no room.

use std::collections::VecDeque;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use super::socket::{Received, RecordSocket};

/// The most bytes of a record that comes.
const RECORD_LIMIT: u64 = 16 << 20;

/// See the module.
#[derive(Debug)]
pub(crate) struct RecordQueue {
    socket: RecordSocket,
    waiting: VecDeque<(Vec<u8>, Option<OwnedFd>)>,
}

impl RecordQueue {
    pub(crate) fn new(socket: RecordSocket) -> Self {
        Self { socket, waiting: VecDeque::new() }
    }

    /// Sends a record, now or when there is room.
    ///
    /// # Errors
    ///
    /// If the other end is gone.
    pub(crate) fn push(&mut self, record: Vec<u8>, with: Option<OwnedFd>) -> io::Result<()> {
        self.waiting.push_back((record, with));
        self.settle()
    }

    /// Sends what waits, as far as there is room.
    ///
    /// # Errors
    ///
    /// If the other end is gone.
    pub(crate) fn settle(&mut self) -> io::Result<()> {
        while let Some((record, with)) = self.waiting.front() {
            match self.socket.send(record, with.as_ref().map(AsFd::as_fd)) {
                Ok(()) => drop(self.waiting.pop_front()),
                Err(error) if may_be_tried_again(&error) => break,
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// How many records wait.
    pub(crate) fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// The socket, to send something at once or not at all.
    pub(crate) fn socket(&self) -> &RecordSocket {
        &self.socket
    }

    /// The next record, if one has come.
    ///
    /// # Errors
    ///
    /// If the other end is gone.
    pub(crate) fn receive(&self) -> io::Result<Option<Received>> {
        let mut was_reset = false;
        loop {
            match self.socket.receive_up_to(RECORD_LIMIT) {
                Ok(None) => return Err(io::ErrorKind::ConnectionReset.into()),
                Ok(received) => return Ok(received),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                // The other end has closed the socket before it has read all. The kernel says so first, and once; what the
                // other end has sent comes after that.
                Err(error) if error.kind() == io::ErrorKind::ConnectionReset && !was_reset => {
                    was_reset = true;
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
                Err(error) => return Err(error),
            }
        }
    }
}

impl AsFd for RecordQueue {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

/// Whether a socket only has no room at the moment.
pub(crate) fn may_be_tried_again(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::super::RecordListener;
    use super::*;

    #[test]
    fn what_came_before_the_end_is_read_even_if_the_other_end_has_not_read_all() {
        let name = format!("hprm-test-queue-{}", std::process::id());
        let listener = RecordListener::bind(&name).unwrap();
        let client = RecordSocket::connect(&name).unwrap();
        let mut queue = RecordQueue::new(listener.accept().unwrap().unwrap());
        queue.push(vec![1], None).unwrap();
        for record in 2..4 {
            client.send(&[record], None).unwrap();
        }
        drop(client);
        let received: Vec<_> = (2..4).map(|_| queue.receive().unwrap().unwrap().0).collect();
        assert_eq!(received, [[2], [3]]);
        assert!(queue.receive().is_err());
    }
}
