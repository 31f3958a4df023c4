//! What the real-time path sees: the words of parameters, and which thread may change which of them
//! when.
//!
//! Each parameter of a process has its words twice: those that the process reads, and those that
//! were offered last. A set changes the offered words of all parameters of the process under one
//! lock, which inherits priority. The process copies them to the words that it reads, at the begin
//! of a cycle, under the same lock, and only if there was an offer. So the words that are read
//! change on the process' own thread alone, and the process reads them without the lock.

use luna_core::current;
use luna_platform::lock::PiLock;
use luna_replay::log::{LONGEST, input_bytes};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The parameters of a process, which it takes all together.
pub struct Reader {
    /// The process: 0 is none.
    pub(super) process: u32,
    pub(super) name: Arc<str>,
    /// Whether words were offered that the process has not taken. Set and cleared under the lock.
    is_fresh: AtomicBool,
    /// What was declared for its process. All of it before the process runs.
    words: PiLock<Vec<Arc<Words>>>,
}

/// The words of a parameter in a process.
struct Words {
    /// What it is called in recordings.
    name: Arc<str>,
    /// What the process reads. Stored under the lock, by the process or before it runs.
    taken: Box<[AtomicU64]>,
    /// The latest values. Accessed under the lock.
    offered: Box<[AtomicU64]>,
}

/// A parameter of a process, as its handles know it.
pub(super) struct Cells {
    pub(super) reader: Arc<Reader>,
    /// Which entry of the store.
    pub(super) entry: usize,
    words: Arc<Words>,
}

impl Reader {
    pub(super) fn new(process: u32, name: &str) -> Arc<Self> {
        Arc::new(Self {
            process,
            name: name.into(),
            is_fresh: AtomicBool::new(false),
            words: PiLock::new(Vec::new()),
        })
    }

    /// Whether a set was offered that the process has not taken.
    #[inline]
    pub(super) fn is_fresh(&self) -> bool {
        self.is_fresh.load(Ordering::Relaxed)
    }

    /// Offers what `fill` [fills in](Cells::fill). Returns whether the process had taken the offer
    /// before.
    pub(super) fn offer(&self, fill: impl FnOnce()) -> bool {
        let _words = self.words.lock();
        fill();
        !self.is_fresh.swap(true, Ordering::Relaxed)
    }

    /// Takes the latest values, if it is the reader's process that asks. O(1) without a new set,
    /// else O(words).
    #[inline]
    pub fn latch(&self) {
        if is_current(self.process) {
            match current::has_replay_log() {
                true => self.latch_with_log(),
                false if self.is_fresh() => drop(self.take_offer()),
                false => {}
            }
        }
    }

    /// Takes the latest values; returns whether there was an offer. By the process, or before it
    /// runs.
    #[cold]
    pub(super) fn take_offer(&self) -> bool {
        if !self.is_fresh() {
            return false;
        }
        let words = self.words.lock();
        for Words { taken, offered, .. } in words.iter().map(|words| &**words) {
            for (taken, offered) in taken.iter().zip(offered) {
                taken.store(offered.load(Ordering::Relaxed), Ordering::Relaxed);
            }
        }
        self.is_fresh.swap(false, Ordering::Relaxed)
    }

    /// Latches a set that is recorded or replayed.
    #[cold]
    fn latch_with_log(&self) {
        if luna_replay::input("parameters", || self.take_offer()) {
            self.words.lock().iter().for_each(|words| words.note());
        }
    }
}

/// Whether `process` is the one that runs here.
#[inline]
fn is_current(process: u32) -> bool {
    current::process(|current| current.is_some_and(|current| current.id().get() == process))
}

impl Cells {
    pub(super) fn new(reader: Arc<Reader>, name: Arc<str>, entry: usize, words: &[u64]) -> Self {
        let copy = || words.iter().map(|&word| AtomicU64::new(word)).collect();
        let words = Arc::new(Words {
            name,
            taken: copy(),
            offered: copy(),
        });
        reader.words.lock().push(words.clone());
        Self {
            reader,
            entry,
            words,
        }
    }

    /// What it is called in recordings.
    pub(super) fn name(&self) -> &str {
        &self.words.name
    }

    /// Fills the words to be offered, in [`Reader::offer`].
    pub(super) fn fill(&self, words: &[u64]) {
        for (offered, &word) in self.words.offered.iter().zip(words) {
            offered.store(word, Ordering::Relaxed);
        }
    }

    /// Its only word.
    #[inline(always)]
    pub(super) fn word(&self) -> u64 {
        self.words.taken[0].load(Ordering::Relaxed)
    }

    /// Several words, all of one value: `make` reads them. A handle may be in another process,
    /// where they may change meanwhile, but for the lock.
    #[inline]
    pub(super) fn several<T>(&self, make: impl Fn(&[AtomicU64]) -> T) -> T {
        let _changes = (!is_current(self.reader.process)).then(|| self.reader.words.lock());
        make(&self.words.taken)
    }
}

impl Words {
    /// Records its value, or takes the recorded one.
    fn note(&self) {
        let mut bytes = [0; LONGEST];
        let bytes = &mut bytes[..8 * self.taken.len()];
        let fill = |bytes: &mut [u8]| {
            for (word, eight) in self.taken.iter().zip(bytes.chunks_exact_mut(8)) {
                eight.copy_from_slice(&word.load(Ordering::Relaxed).to_le_bytes());
            }
        };
        if input_bytes(&self.name, bytes, fill) {
            let (eights, _) = bytes.as_chunks::<8>();
            for (word, eight) in self.taken.iter().zip(eights) {
                word.store(u64::from_le_bytes(*eight), Ordering::Relaxed);
            }
        }
    }
}

luna_platform::debug_fields!(Reader, |reader| name: reader.name);
