//! A publisher, the owner, and other readers, in any order: no reader sees parts of two values, the
//! owner sees a value until it takes a new one, and the last one is never lost.

use super::*;
use luna_platform::sync::Arc;

/// A value of two words.
struct Scene {
    slots: LatestSlots,
    words: SlotMemory<AtomicU64>,
}

impl Scene {
    fn new() -> Arc<Self> {
        Arc::new(Self {
            slots: LatestSlots::new(),
            words: SlotMemory::new(2, |_, _| AtomicU64::new(1)),
        })
    }

    fn put(&self, value: u64) {
        self.slots.publish(value, |slot| {
            self.words.reach(slot, |_, _| AtomicU64::new(0));
            for word in self.words.slot(slot) {
                word.store(value, Ordering::Release);
            }
        });
    }

    /// As the owner does it.
    fn own(&self) -> [u64; 2] {
        let words = self.words.slot(self.slots.front());
        std::array::from_fn(|word| words[word].load(Ordering::Relaxed))
    }

    /// As another thread does it: at most two copies, and no parts of two values.
    fn other(&self) -> u64 {
        let mut copies = 0;
        let [first, second] = self.slots.read(|slot| {
            copies += 1;
            let words = self.words.slot(slot);
            std::array::from_fn(|word| words[word].load(Ordering::Acquire))
        });
        assert!(copies <= 2);
        assert_eq!(first, second);
        first
    }
}

#[test]
fn the_owner_sees_whole_values_in_their_order_and_at_last_the_last() {
    loom::model(|| {
        let scene = Scene::new();
        let publisher = scene.clone();
        let publishes = loom::thread::spawn(move || {
            for value in 2..=4 {
                publisher.put(value);
            }
        });
        let mut last = 1;
        for _ in 0..2 {
            scene.slots.latch();
            let [first, second] = scene.own();
            assert_eq!(first, second);
            assert!(first >= last);
            last = first;
            // As long as it takes no new one.
            assert_eq!(scene.own(), [last; 2]);
        }
        publishes.join().unwrap();
        scene.slots.latch();
        assert_eq!((scene.own(), scene.slots.number()), ([4; 2], 4));
    });
}

/// Two values are there before, so that slots are used again. The reader may stop between any two
/// steps.
#[test]
fn another_reader_sees_no_parts_of_two_values() {
    bounded(|| {
        let scene = Scene::new();
        scene.put(2);
        let (publisher, other) = (scene.clone(), scene.clone());
        let publishes = loom::thread::spawn(move || {
            publisher.put(3);
            publisher.put(4);
            publisher.put(5);
        });
        let reads = loom::thread::spawn(move || {
            let first = other.other();
            assert!(other.other() >= first);
        });
        for _ in 0..3 {
            scene.slots.latch();
        }
        publishes.join().unwrap();
        reads.join().unwrap();
    });
}

/// The slot that it looks at may be given away and written again at any moment.
#[test]
fn another_reader_never_runs_ahead_of_the_owner() {
    loom::model(|| {
        let scene = Scene::new();
        scene.put(2);
        let (publisher, other) = (scene.clone(), scene.clone());
        let publishes = loom::thread::spawn(move || {
            publisher.put(3);
            publisher.put(4);
        });
        let reads = loom::thread::spawn(move || other.other());
        scene.slots.latch();
        let taken = scene.slots.number();
        publishes.join().unwrap();
        let read = reads.join().unwrap();
        assert!(read == 1 || read == taken, "{read}, but {taken} was taken");
    });
}

/// What one reader has got, another gets too, however far the owner's `latch` is.
#[test]
fn two_readers_agree_on_the_order() {
    bounded(|| {
        let scene = Scene::new();
        scene.put(2);
        let (one, other) = (scene.clone(), scene.clone());
        let seen = Arc::new(AtomicU64::new(0));
        let reported = seen.clone();
        let reads = loom::thread::spawn(move || {
            one.other();
            reported.store(one.other(), Ordering::Release);
        });
        let checks = loom::thread::spawn(move || {
            let before = seen.load(Ordering::Acquire);
            assert!(other.other() >= before);
        });
        scene.slots.latch();
        scene.put(3);
        scene.slots.latch();
        reads.join().unwrap();
        checks.join().unwrap();
    });
}

/// Models of this size are looked at with a bound on preemptions.
fn bounded(model: impl Fn() + Sync + Send + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound.get_or_insert(2);
    builder.check(model);
}
