//! A memory as weak as the language permits, for tests: what runs on it meets everything that a load may get.
//!
//! A word of this memory keeps all values that it has had. A side that loads it gets any of them that is not older than one
//! that it knows of, and by acquiring what was released it comes to know what the other side knew. Fences are those of the
//! language: an acquire fence acquires what the loads before it have found, a release fence releases with the stores after
//! it, and those that are sequentially consistent have one order. No load gets what is stored later.
//!
//! [`explore`] tries every order of the steps of some sides, with everything that each load may get.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::Ordering;

use crate::word::Word;

/// For each word, the number of the newest of its values that one knows of.
type Known = BTreeMap<usize, usize>;

#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
struct Value {
    value: u64,
    /// What a side knows once it has acquired it.
    tells: Known,
}

/// What one side knows.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
struct View {
    known: Known,
    /// What it will know after an acquire fence.
    found: Known,
    /// What it knew at its last release fence.
    released: Known,
}

/// All words and what each side knows of them, while one of the sides takes a step.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(crate) struct WeakMemory {
    values: BTreeMap<usize, Vec<Value>>,
    views: Vec<View>,
    /// What sides knew at their fences that are sequentially consistent.
    fenced: Known,
    /// Whether fences do nothing, so that a test can show what they are for.
    without_fences: bool,
    side: usize,
    /// Which values this step's loads get, by how many newer ones there are; the newest, after those.
    wanted: Vec<usize>,
    /// The same with how many each load has had to choose from.
    taken: Vec<(usize, usize)>,
}

thread_local! {
    static MEMORY: RefCell<WeakMemory> = RefCell::default();
}

/// A word of the memory of this thread, by its position.
#[derive(Clone, Debug)]
pub(crate) struct WeakWord(pub(crate) usize);

impl Word for WeakWord {
    fn load(&self, order: Ordering) -> u64 {
        MEMORY.with_borrow_mut(|memory| memory.load(self.0, order))
    }

    fn store(&self, value: u64, order: Ordering) {
        MEMORY.with_borrow_mut(|memory| memory.put(self.0, value, order, Known::new()));
    }

    fn swap(&self, value: u64, order: Ordering) -> u64 {
        MEMORY.with_borrow_mut(|memory| memory.swap(self.0, value, order))
    }

    fn fence(order: Ordering) {
        MEMORY.with_borrow_mut(|memory| memory.fence(order));
    }
}

fn learn(known: &mut Known, told: &Known) {
    for (at, number) in told {
        let mine = known.entry(*at).or_default();
        *mine = *number.max(mine);
    }
}

fn acquires(order: Ordering) -> bool {
    matches!(order, Ordering::Acquire | Ordering::AcqRel | Ordering::SeqCst)
}

fn releases(order: Ordering) -> bool {
    matches!(order, Ordering::Release | Ordering::AcqRel | Ordering::SeqCst)
}

impl WeakMemory {
    /// A memory of zeros for so many sides.
    pub(crate) fn new(sides: usize) -> Self {
        Self { views: vec![View::default(); sides], ..Self::default() }
    }

    /// The same, in which fences do nothing.
    pub(crate) fn without_fences(sides: usize) -> Self {
        Self { without_fences: true, ..Self::new(sides) }
    }

    /// Does something as the first side, of which all sides know then.
    pub(crate) fn prepared<T>(self, prepare: impl FnOnce() -> T) -> (T, Self) {
        MEMORY.set(self);
        let made = prepare();
        let mut memory = MEMORY.take();
        let first = memory.views[0].clone();
        memory.views.fill(first);
        (made, memory)
    }

    fn view(&mut self) -> &mut View {
        &mut self.views[self.side]
    }

    fn values(&mut self, at: usize) -> &mut Vec<Value> {
        self.values.entry(at).or_insert_with(|| vec![Value::default()])
    }

    fn load(&mut self, at: usize, order: Ordering) -> u64 {
        // What was never stored is zero, and tells nothing.
        let Some(values) = self.values.get(&at) else { return 0 };
        let newest = values.len() - 1;
        let oldest = self.view().known.get(&at).copied().unwrap_or_default();
        let newer = self.wanted.get(self.taken.len()).copied().unwrap_or_default();
        self.taken.push((newer, newest - oldest + 1));
        self.take(at, newest - newer, order)
    }

    fn take(&mut self, at: usize, number: usize, order: Ordering) -> u64 {
        let Value { value, tells } = self.values(at)[number].clone();
        let view = self.view();
        view.known.insert(at, number);
        learn(if acquires(order) { &mut view.known } else { &mut view.found }, &tells);
        value
    }

    /// Nothing comes between what a swap gets and what it puts there, so a side that acquires the latter knows also what
    /// the former tells.
    fn swap(&mut self, at: usize, value: u64, order: Ordering) -> u64 {
        let newest = self.values(at).len() - 1;
        let tells = self.values(at)[newest].tells.clone();
        let found = self.take(at, newest, order);
        self.put(at, value, order, tells);
        found
    }

    fn put(&mut self, at: usize, value: u64, order: Ordering, mut tells: Known) {
        let number = self.values(at).len();
        let view = self.view();
        view.known.insert(at, number);
        learn(&mut tells, if releases(order) { &view.known } else { &view.released });
        self.values(at).push(Value { value, tells });
    }

    fn fence(&mut self, order: Ordering) {
        if self.without_fences {
            return;
        }
        let view = &mut self.views[self.side];
        if acquires(order) {
            learn(&mut view.known, &std::mem::take(&mut view.found));
        }
        if order == Ordering::SeqCst {
            learn(&mut view.known, &self.fenced);
            self.fenced.clone_from(&view.known);
        }
        if releases(order) {
            view.released.clone_from(&view.known);
        }
    }

    /// Forgets values that no side can get any more, so that states are equal whose future is.
    fn forget(&mut self) {
        let known = |view: &View, at: &usize| view.known.get(at).copied().unwrap_or_default();
        let oldest = |at: &usize| {
            (*at, self.views.iter().map(|view| known(view, at)).min().unwrap_or_default())
        };
        let oldest: Known = self.values.keys().map(oldest).collect();
        let shift = |known: &mut Known| {
            known.iter_mut().for_each(|(at, number)| *number = number.saturating_sub(oldest[at]));
            known.retain(|_, number| *number > 0);
        };
        for View { known, found, released } in &mut self.views {
            [known, found, released].into_iter().for_each(shift);
        }
        shift(&mut self.fenced);
        for (at, values) in &mut self.values {
            values.drain(..oldest[at]);
            values.iter_mut().for_each(|value| shift(&mut value.tells));
        }
    }

    /// What the loads of the next attempt at this step are to get; none, if all has been tried.
    fn next_wanted(&self) -> Option<Vec<usize>> {
        let mut taken = self.taken.as_slice();
        while let Some(((newer, choices), before)) = taken.split_last() {
            if newer + 1 < *choices {
                return Some(before.iter().map(|(it, _)| *it).chain([newer + 1]).collect());
            }
            taken = before;
        }
        None
    }
}

/// Some sides, of which one at a time takes a step.
pub(crate) trait Sides: Clone {
    /// All that a state consists of, besides the memory.
    type Key: Ord;

    fn key(&self) -> Self::Key;

    /// The sides that can take a step. Fails if a side should be able to, and is not.
    fn able(&self) -> Vec<usize>;

    /// Has a side take a step. Fails if it finds what it should not.
    fn step(&mut self, side: usize);
}

/// Goes to every state that the sides can get into, and counts these.
pub(crate) fn explore<S: Sides>((first, memory): (S, WeakMemory)) -> usize {
    let mut open = vec![(first, memory)];
    let mut seen = BTreeSet::new();
    while let Some((sides, memory)) = open.pop() {
        if !seen.insert((sides.key(), memory.clone())) {
            continue;
        }
        for side in sides.able() {
            let mut wanted = Some(Vec::new());
            while let Some(these) = wanted {
                MEMORY.set(WeakMemory { side, wanted: these, ..memory.clone() });
                let mut next = sides.clone();
                next.step(side);
                let mut after = MEMORY.take();
                wanted = after.next_wanted();
                (after.side, after.wanted, after.taken) = Default::default();
                after.forget();
                open.push((next, after));
            }
        }
    }
    seen.len()
}
