//! How many errors are too many.

/// A leaky bucket of errors: each error fills it, each good cycle drains some, and a full bucket
/// means too many errors.
///
/// ```
/// use hostmot2::Bucket;
///
/// let mut bucket = Bucket::new(10, 1, 30); // three in a row, or more than one in eleven for long
/// assert!(!bucket.fill() && !bucket.fill());
/// for _ in 0..20 { bucket.leak(); }
/// assert!(!bucket.fill() && !bucket.fill());
/// assert!(bucket.fill());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bucket {
    fill: u32,
    leak: u32,
    limit: u32,
    level: u32,
}

impl Bucket {
    /// An empty bucket: each error adds `fill`, each good cycle removes `leak`, and it holds less
    /// than `limit`.
    pub const fn new(fill: u32, leak: u32, limit: u32) -> Self {
        Self {
            fill,
            leak,
            limit,
            level: 0,
        }
    }

    /// Counts an error. Returns whether there were too many. O(1).
    pub fn fill(&mut self) -> bool {
        self.level = self.level.saturating_add(self.fill);
        self.is_full()
    }

    /// A good cycle. O(1).
    pub fn leak(&mut self) {
        self.level = self.level.saturating_sub(self.leak);
    }

    /// Whether there were too many.
    pub const fn is_full(&self) -> bool {
        self.level >= self.limit
    }

    /// The present level, from 0.
    pub const fn level(&self) -> u32 {
        self.level
    }

    /// How many errors in a row an empty one takes before it is full.
    pub const fn burst(&self) -> u32 {
        match self.fill {
            0 => u32::MAX,
            fill => self.limit.saturating_sub(1) / fill,
        }
    }
}
