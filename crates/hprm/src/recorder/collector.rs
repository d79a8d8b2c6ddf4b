//! The collector: a thread that empties the rings, and hands what it finds to readers.

use std::fmt;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::Recorder;
use super::lanes::Lanes;
use super::record::Words;
use super::user::Tracepoints;

/// How long a record waits for the collector at most, if there are few.
const PERIOD: Duration = Duration::from_millis(20);

/// Gets all records of a process, while it runs. It is called on the collector's thread.
pub trait Reader: Send {
    /// Tracepoints with this number have this name.
    ///
    /// # Errors
    ///
    /// If the reader cannot go on; then it gets no more.
    fn name(&mut self, number: u32, name: &str) -> io::Result<()>;

    /// More records of a lane, in their order.
    ///
    /// # Errors
    ///
    /// As [`Self::name`].
    fn records(&mut self, lane: usize, records: &[Words]) -> io::Result<()>;

    /// There are no more records.
    ///
    /// # Errors
    ///
    /// As [`Self::name`].
    fn end(&mut self) -> io::Result<()>;
}

/// What became of a recording.
#[derive(Debug)]
pub struct Collected {
    /// How many records were lost because a ring was full.
    pub lost: u64,
}

/// The recording of a process, or of a thread that is a federate. The records that are there when it is dropped are
/// collected first.
pub(crate) struct Recording {
    lanes: Arc<Lanes>,
    stop: Arc<AtomicBool>,
    /// None once it has ended.
    thread: Mutex<Option<JoinHandle<io::Result<()>>>>,
    /// A forked process has no such thread.
    process: u32,
}

impl fmt::Debug for Recording {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recording").field("lanes", &self.lanes.len()).finish_non_exhaustive()
    }
}

impl Recording {
    /// Starts the collector of `lanes`.
    pub(crate) fn start(lanes: Arc<Lanes>, readers: Vec<Box<dyn Reader>>) -> io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let (shared, asked) = (Arc::clone(&lanes), Arc::clone(&stop));
        let collect =
            move || Collector { lanes: shared, readers, known: 0, batch: Vec::new() }.run(&asked);
        let thread = thread::Builder::new().name("trace".to_owned()).spawn(collect)?;
        lanes.collected_by(thread.thread().clone());
        let process = std::process::id();
        Ok(Self { lanes, stop, thread: Mutex::new(Some(thread)), process })
    }

    pub(crate) fn recorder(&self) -> Recorder {
        Recorder::on(Arc::clone(&self.lanes))
    }

    pub(crate) fn tracepoints(&self) -> Tracepoints {
        Tracepoints::on(Arc::clone(&self.lanes))
    }

    /// Collects what is there, and ends. Only the first call does something.
    ///
    /// # Errors
    ///
    /// The first error of a reader.
    pub(crate) fn finish(&self) -> io::Result<Collected> {
        let mut thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(thread) = thread.take().filter(|_| std::process::id() == self.process) {
            self.stop.store(true, Ordering::Release);
            thread.thread().unpark();
            thread.join().unwrap_or_else(|_| Err(io::Error::other("its thread panicked")))?;
        }
        Ok(Collected { lost: self.lanes.lost() })
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        // The loop has called it before if it has an error to tell.
        let _ = self.finish();
    }
}

struct Collector {
    lanes: Arc<Lanes>,
    readers: Vec<Box<dyn Reader>>,
    /// How many names the readers have been told.
    known: usize,
    /// The records of one lane. Empty between rounds; the collector keeps the vector for its memory.
    batch: Vec<Words>,
}

impl Collector {
    fn run(mut self, stop: &AtomicBool) -> io::Result<()> {
        let mut failure = None;
        loop {
            let is_last = stop.load(Ordering::Acquire);
            self.collect(is_last, &mut failure);
            if is_last {
                return failure.map_or(Ok(()), Err);
            }
            thread::park_timeout(PERIOD);
        }
    }

    /// A reader that has failed is asked no more; the rings are emptied in any case.
    fn collect(&mut self, is_last: bool, failure: &mut Option<io::Error>) {
        let mut tell =
            |readers: &mut Vec<Box<dyn Reader>>,
             what: &mut dyn FnMut(&mut dyn Reader) -> io::Result<()>| {
                readers.retain_mut(|reader| match what(&mut **reader) {
                    Ok(()) => true,
                    Err(error) => {
                        failure.get_or_insert(error);
                        false
                    }
                });
            };
        for lane in 0..self.lanes.len() {
            self.lanes.drain(lane, |words| self.batch.push(words));
            let missing = self.lanes.missing(lane).filter(|_| is_last);
            self.batch.extend(missing.map(|record| record.words()));
            // A name is known before the records that have its number.
            for name in self.lanes.names_since(self.known) {
                self.known += 1;
                let number = u32::try_from(self.known).unwrap_or(u32::MAX);
                tell(&mut self.readers, &mut |reader| reader.name(number, &name));
            }
            if !self.batch.is_empty() {
                tell(&mut self.readers, &mut |reader| reader.records(lane, &self.batch));
                self.batch.clear();
            }
        }
        if is_last {
            tell(&mut self.readers, &mut |reader| reader.end());
        }
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::Tag;

    use super::super::record::{Flags, Kind, Record};
    use super::*;

    /// What a reader has got.
    #[derive(Clone, Default)]
    struct Observer(Arc<Mutex<Vec<String>>>);

    impl Observer {
        fn say(&self, what: String) {
            self.0.lock().unwrap().push(what);
        }
    }

    impl Reader for Observer {
        fn name(&mut self, number: u32, name: &str) -> io::Result<()> {
            self.say(format!("{number} is {name}"));
            Ok(())
        }

        fn records(&mut self, lane: usize, records: &[Words]) -> io::Result<()> {
            for record in records.iter().map(|words| Record::of_words(*words).unwrap()) {
                self.say(format!(
                    "{lane}: {:?} {} {:?}",
                    record.kind, record.subject, record.values
                ));
            }
            Ok(())
        }

        fn end(&mut self) -> io::Result<()> {
            self.say("end".to_owned());
            Ok(())
        }
    }

    struct Broken;

    impl Reader for Broken {
        fn name(&mut self, _: u32, _: &str) -> io::Result<()> {
            Ok(())
        }

        fn records(&mut self, _: usize, _: &[Words]) -> io::Result<()> {
            Err(io::ErrorKind::StorageFull.into())
        }

        fn end(&mut self) -> io::Result<()> {
            unreachable!("it has failed")
        }
    }

    fn scheduled(subject: u32) -> Record {
        Record::new(Kind::Scheduled, Flags::NONE, subject, Tag::START)
    }

    #[test]
    fn readers_get_all_records_and_names() {
        let lanes = Arc::new(Lanes::new(2, 8));
        let [first, second] = [Observer::default(), Observer::default()];
        let readers: Vec<Box<dyn Reader>> = vec![Box::new(first.clone()), Box::new(second.clone())];
        let recording = Recording::start(Arc::clone(&lanes), readers).unwrap();
        let (recorder, tracepoints) = (recording.recorder(), recording.tracepoints());
        recorder.record(0, || scheduled(7));
        recorder.record(1, || scheduled(8));
        let number = tracepoints.name("grasp");
        assert_eq!(tracepoints.name("grasp"), number);
        tracepoints.hit(number, Some(-3));
        assert_eq!(recording.finish().unwrap().lost, 0);
        let mut seen = first.0.lock().unwrap().clone();
        assert_eq!(seen, *second.0.lock().unwrap());
        assert_eq!(seen.pop().unwrap(), "end");
        seen.sort();
        let value = u64::MAX - 2;
        assert_eq!(
            seen,
            [
                "0: Scheduled 7 [0, 0]".to_owned(),
                "1 is grasp".to_owned(),
                "1: Scheduled 8 [0, 0]".to_owned(),
                format!("2: Tracepoint 1 [{value}, 0]"),
            ]
        );
    }

    #[test]
    fn a_reader_that_fails_does_not_stop_the_others() {
        let lanes = Arc::new(Lanes::new(1, 8));
        let seen = Observer::default();
        let readers: Vec<Box<dyn Reader>> = vec![Box::new(Broken), Box::new(seen.clone())];
        let recording = Recording::start(lanes, readers).unwrap();
        recording.recorder().record(0, || scheduled(1));
        let failure = recording.finish().unwrap_err();
        assert_eq!(failure.kind(), io::ErrorKind::StorageFull);
        assert_eq!(seen.0.lock().unwrap().len(), 2);
    }

    #[test]
    fn what_no_ring_has_room_for_is_counted() {
        let lanes = Arc::new(Lanes::new(1, 4));
        let recorder = Recorder::on(Arc::clone(&lanes));
        (0..7).for_each(|number| recorder.record(0, || scheduled(number)));
        let seen = Observer::default();
        let recording = Recording::start(lanes, vec![Box::new(seen.clone())]).unwrap();
        assert_eq!(recording.finish().unwrap().lost, 3);
        let seen = seen.0.lock().unwrap();
        assert!(seen.contains(&"0: Lost 0 [3, 0]".to_owned()), "{seen:?}");
    }
}
