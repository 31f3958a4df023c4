//! The models under shuttle: not every interleaving, but many random ones, of as many threads and
//! steps as a model has.
//!
//! ```text
//! RUSTFLAGS="--cfg loom --cfg shuttle" cargo test -p luna-channels --release --lib
//! ```
//!
//! `LUNA_SCHEDULES` says how many schedules each model gets, 10 000 if it is not set: half of them
//! switch threads at random at every step, the other half at two steps only (probabilistic
//! concurrency testing), which finds what needs one thread to rest for long. All accesses are
//! sequentially consistent here: what a weaker order allows is loom's part.
//!
//! A failure prints its schedule, as a string (to be given with its line breaks), and under the
//! first kind its seed. Either runs that failure again, and nothing else, the schedule through
//! `shuttle::replay`:
//!
//! ```text
//! LUNA_SCHEDULE=<the string> RUSTFLAGS=.. \
//!     cargo test -p luna-channels --release --lib -- --exact <the test's name>
//! SHUTTLE_RANDOM_SEED=<the seed> LUNA_SCHEDULES=2 RUSTFLAGS=.. \
//!     cargo test -p luna-channels --release --lib -- --exact <the test's name>
//! ```

use std::env;
use std::sync::Arc;

const SCHEDULES: usize = 10_000;
/// Switches at one less than so many steps.
const DEPTH: usize = 3;

pub(super) fn check(model: impl Fn() + Send + Sync + 'static) {
    if let Ok(schedule) = env::var("LUNA_SCHEDULE") {
        return shuttle::replay(model, schedule.trim());
    }
    let schedules = env::var("LUNA_SCHEDULES").map_or(SCHEDULES, |count| {
        count.parse().expect("LUNA_SCHEDULES is a number")
    });
    let model = Arc::new(model);
    let again = model.clone();
    shuttle::check_random(move || model(), schedules.div_ceil(2));
    shuttle::check_pct(move || again(), schedules / 2, DEPTH);
}
