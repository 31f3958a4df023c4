use super::*;

/// Slots with a value of one word.
struct Scene {
    slots: LatestSlots,
    words: SlotMemory<AtomicU64>,
}

impl Scene {
    fn new() -> Self {
        Self {
            slots: LatestSlots::new(),
            words: SlotMemory::new(1, |_, _| AtomicU64::new(1)),
        }
    }

    fn put(&self, value: u64) -> bool {
        self.slots.publish(value, |slot| {
            self.words.reach(slot, |_, _| AtomicU64::new(0));
            self.words.slot(slot)[0].store(value, Ordering::Release);
        })
    }

    fn load(&self, slot: usize) -> u64 {
        self.words.slot(slot)[0].load(Ordering::Acquire)
    }

    fn get(&self) -> u64 {
        self.slots.read(|slot| self.load(slot))
    }

    /// A read with a change of the front to `values[0]` during its first copy, so that the second
    /// is counted; `then` happens in the middle of that.
    fn get_slowly(&self, value: u64, then: &dyn Fn()) -> u64 {
        let mut copies = 0;
        let read = self.slots.read(|slot| {
            copies += 1;
            if copies == 1 {
                self.put(value);
                assert!(self.slots.latch());
            } else {
                then();
            }
            self.load(slot)
        });
        assert_eq!(copies, 2);
        read
    }
}

#[test]
fn the_latest_is_taken_and_only_when_it_is_latched() {
    let scene = Scene::new();
    assert!(!scene.slots.latch());
    for round in 1..20 {
        assert!(scene.put(10 * round), "what was there is taken");
        assert!(!scene.put(10 * round + 1));
        let before = if round == 1 { 1 } else { 10 * (round - 1) + 1 };
        assert_eq!(scene.get(), before);
        assert!(scene.slots.is_fresh() && scene.slots.latch());
        let value = 10 * round + 1;
        assert_eq!((scene.get(), scene.slots.number()), (value, value));
        assert!(!scene.slots.latch());
    }
    assert_eq!(scene.slots.slots.count(), SLOTS);
}

/// With three slots the read never returned here.
#[test]
fn an_owner_that_stops_in_its_latch_holds_up_nobody() {
    for steps in 0..=3 {
        let scene = Scene::new();
        scene.put(2);
        let new = (steps > 0).then(|| scene.slots.take());
        let old = new.filter(|_| steps > 1).map(|new| scene.slots.pin(new));
        if let Some(new) = new.filter(|_| steps > 2) {
            scene.slots.show(new);
        }
        for value in 3..=20 {
            scene.put(value);
        }
        let mut copies = 0;
        let read = scene.slots.read(|slot| {
            copies += 1;
            scene.load(slot)
        });
        assert_eq!((read, copies), (if steps > 2 { 2 } else { 1 }, 1));
        // The owner goes on.
        if let Some(new) = new {
            let old = old.unwrap_or_else(|| scene.slots.pin(new));
            scene.slots.show(new);
            scene.slots.retire(old);
            assert_eq!(scene.get(), 2);
        }
        assert!(scene.slots.latch());
        assert_eq!(scene.get(), 20);
        assert_eq!(scene.slots.slots.count(), SLOTS);
    }
}

#[test]
fn a_reader_whose_check_fails_copies_once_more() {
    let scene = Scene::new();
    let read = scene.get_slowly(2, &|| {
        for value in 3..=20 {
            scene.put(value);
            scene.slots.latch();
        }
    });
    assert_eq!((read, scene.get()), (2, 20));
}

/// The owner has named the new slot to readers that enter, and not to those that check.
#[test]
fn no_read_finds_an_older_value_than_one_before() {
    let scene = Scene::new();
    let mut copies = 0;
    let mut taken = None;
    let read = scene.slots.read(|slot| {
        copies += 1;
        if copies == 1 {
            scene.put(2);
            scene.slots.latch();
            scene.put(3);
            let new = scene.slots.take();
            taken = Some((new, scene.slots.pin(new)));
        }
        scene.load(slot)
    });
    assert_eq!((read, copies, scene.get()), (3, 2, 3));
    let (new, old) = taken.unwrap();
    scene.slots.show(new);
    scene.slots.retire(old);
    assert_eq!((scene.get(), scene.slots.number()), (3, 3));
}

#[test]
fn each_reader_that_stops_keeps_its_slot_however_many_they_are() {
    let scene = Scene::new();
    nested(&scene, 2, 30);
    let count = scene.slots.slots.count();
    assert!((30..=64).contains(&count), "{count}");
    // Nothing is lost: the same again takes no more.
    nested(&scene, 100, 30);
    assert_eq!(scene.slots.slots.count(), count);
}

/// So many readers stop in the middle of their second copies, each in another value.
fn nested(scene: &Scene, value: u64, more: u64) {
    let read = scene.get_slowly(value, &|| {
        if more > 1 {
            nested(scene, value + 1, more - 1);
        }
    });
    assert_eq!(read, value);
}

#[test]
fn a_copy_that_panics_leaves_its_slot() {
    let scene = Scene::new();
    for round in 0..20 {
        let fails = || panic!("the copy fails");
        let read = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            scene.get_slowly(2 + round, &fails)
        }));
        read.unwrap_err();
    }
    assert_eq!(scene.slots.slots.count(), SLOTS);
}
