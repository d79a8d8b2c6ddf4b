//! Federations of threads, which exchange values as they are.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use hprm::ValueExchange;
use hprm_core::{Body, ReactionId, Scheduler};

use crate::common::{BOTH, Bytes, Gather, React, federation_in, gather, rounds_of, well};

#[test]
fn any_messages_within_a_process() {
    for coordination in BOTH {
        for (len, rounds) in [(64, 200), (3_000_000, 20)] {
            let (program, react) = rounds_of(coordination, len, rounds);
            well(federation_in(&ValueExchange::new(), program, &react));
        }
    }
}

#[test]
fn within_a_process_the_value_itself_arrives() {
    for coordination in BOTH {
        let Gather { program, out, start, requests, .. } = gather(coordination, 2);
        let sent: Arc<Vec<u8>> = Arc::new(vec![7; 3_000_000]);
        let (value, arrived) = (Arc::clone(&sent), Arc::new(AtomicU32::new(0)));
        let count = Arc::clone(&arrived);
        let react = move |scheduler: &mut Scheduler<Bytes>, id: ReactionId, _: Body| {
            if id == start {
                scheduler.set(out, Bytes::Own(Arc::clone(&value)));
                return Ok(());
            }
            let request = requests.iter().find_map(|port| scheduler.port(*port)).unwrap();
            let Bytes::Own(request) = request else { panic!("it went through a store") };
            assert!(Arc::ptr_eq(request, &value));
            if count.fetch_add(1, Ordering::Relaxed) == 1 {
                scheduler.request_stop();
            }
            Ok(())
        };
        let (exchange, react): (_, Arc<React>) = (ValueExchange::new(), Arc::new(react));
        let federation = federation_in(&exchange, program, &react);
        assert!(federation.outcomes.iter().all(Result::is_ok), "{:?}", federation.outcomes);
        assert_eq!(arrived.load(Ordering::Relaxed), 2);
        drop(react);
        assert_eq!(Arc::strong_count(&sent), 1, "the exchange keeps nothing");
    }
}
