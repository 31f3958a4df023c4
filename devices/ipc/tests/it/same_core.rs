//! Two programs of different priority and a burner between them, on one core. The high program's
//! link works beside a partner that loses the core anywhere in an operation. What does not need the
//! partner's answer ends without it, so before the burner's burst does.

use crate::child::Program;
use crate::kernel::{Kept, KeptOff, burn, spoilt};
use crate::shared::{Random, say, seed, skip};
use crate::{Block, block, channel_name, has_real_time};
use luna::prelude::*;
use luna_ipc::{Endpoint, Status};
use luna_platform::thread::available_cores;
use nix::sched::{CpuSet, sched_setaffinity};
use nix::unistd::Pid;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::time::Duration;

/// Operations of the high side.
const ROUNDS: u64 = 1500;
/// Steps of the burner, of 2 µs of processor time, that may fall into an operation. One that waits
/// for the low program waits for the rest of a burst, of 500 µs.
const BURNT: u64 = 25;

/// The core of all that is in these tests.
pub(crate) fn core() -> usize {
    available_cores()[0]
}

/// A thread at FIFO 50 that burns, and leaves the core to the low program in between.
struct Burner {
    steps: Arc<AtomicU64>,
    over: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Burner {
    fn start() -> Self {
        let (steps, over) = (
            Arc::new(AtomicU64::new(0)),
            Arc::new(AtomicBool::new(false)),
        );
        let (burnt, ends) = (steps.clone(), over.clone());
        let thread = std::thread::spawn(move || {
            let parameter = libc::sched_param { sched_priority: 50 };
            // SAFETY: the parameter is a valid structure, and the thread is this one.
            let refused = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameter) };
            assert_eq!(refused, 0);
            let mut cores = CpuSet::new();
            cores.set(core()).unwrap();
            sched_setaffinity(Pid::from_raw(0), &cores).unwrap();
            while !ends.load(SeqCst) {
                for _ in 0..250 {
                    burn(Duration::from_micros(2));
                    burnt.fetch_add(1, SeqCst);
                }
                // Load, not synchronization: the low program has the core meanwhile.
                std::thread::sleep(Duration::from_micros(150));
            }
        });
        Self {
            steps,
            over,
            thread: Some(thread),
        }
    }
}

impl Drop for Burner {
    fn drop(&mut self) {
        self.over.store(true, SeqCst);
        let ended = self.thread.take().map(|thread| thread.join());
        assert!(ended.is_some_and(|ended| ended.is_ok()) || std::thread::panicking());
    }
}

/// Judges the operations of the high side by what was burnt meanwhile.
struct Judge {
    burnt: Arc<AtomicU64>,
    random: Random,
    kept_off: KeptOff,
    before: (u64, Kept),
    inverted: Vec<u64>,
    excused: u64,
    most: u64,
}

impl Judge {
    /// To be called on the high side's thread.
    fn new(burnt: Arc<AtomicU64>, random: Random) -> Self {
        let kept_off = KeptOff::new();
        Self {
            burnt,
            random,
            before: (0, kept_off.so_far()),
            kept_off,
            inverted: Vec::new(),
            excused: 0,
            most: 0,
        }
    }

    /// Leaves the core to the others until a random instant, and begins an operation.
    async fn begin(&mut self) {
        luna::after(Duration::from_nanos(
            10_000 + self.random.below(300_000_u64),
        ))
        .await;
        self.before = (self.burnt.load(SeqCst), self.kept_off.so_far());
    }

    /// Lets the link take its turns, and ends the operation.
    async fn end(&mut self) {
        for _ in 0..30 {
            luna::yield_now().await;
        }
        let steps = self.burnt.load(SeqCst) - self.before.0;
        if self.kept_off.so_far().differs_from(&self.before.1) {
            self.excused += 1;
            return;
        }
        self.most = self.most.max(steps);
        if steps > BURNT {
            self.inverted.push(steps);
        }
    }
}

fn high(
    link: impl Process + Send + 'static,
    body: impl Future<Output = luna::Result<()>> + Send + 'static,
) {
    let mut system = System::new("high");
    let main = system.executor("main").policy(Policy::fifo(80));
    let main = main.core(core()).build().unwrap();
    main.process("link").priority(2).spawn(link).unwrap();
    main.process("body").priority(1).spawn(body).unwrap();
    system.run().unwrap();
}

fn verdict(test: &str, judge: &Judge, status: &Status) {
    say(&format!(
        "{test}: {ROUNDS} operations of fifo:80, at most {} steps of fifo:50 in one, {} not judged; {} values crossed",
        judge.most,
        judge.excused,
        status.acknowledged()
    ));
    assert!(
        judge.inverted.len() as u64 <= spoilt(ROUNDS),
        "{} operations waited for the burner, of at most {} steps",
        judge.inverted.len(),
        judge.most
    );
    assert!(judge.excused < ROUNDS / 2, "{} not judged", judge.excused);
    assert!(status.acknowledged() > 20, "the low program took part");
}

fn cannot_run() -> bool {
    let can = has_real_time();
    if !can {
        skip("SCHED_FIFO is not granted");
    }
    !can
}

#[test]
fn a_high_sender_never_waits_for_the_burner() {
    own_process!();
    if cannot_run() {
        return;
    }
    for looks in [0, 20] {
        let name = channel_name("high-sends");
        let burner = Burner::start();
        let _low = Program::start("low-takes", &name, Path::new(""));
        let opened = Endpoint::new(&name).buffered_sender::<Block>(Buffer::fifo(4));
        let (sender, link) = opened.unwrap();
        let link = link.looks(looks);
        let status = link.status();
        let joined = status.clone();
        let (result, of_judge) = std::sync::mpsc::channel();
        let (random, burnt) = (Random::new(seed()), burner.steps.clone());
        high(link, async move {
            while !joined.has_joined() {
                luna::after(Duration::from_millis(1)).await;
            }
            let mut judge = Judge::new(burnt, random);
            for number in 1..=ROUNDS {
                // In every other operation the link has nothing under way, so it publishes this
                // value; in the others it waits for an answer.
                while joined.acknowledged() + 1 + number % 2 < number {
                    luna::after(Duration::from_micros(50)).await;
                }
                judge.begin().await;
                sender.send(block(number)).await?;
                // The link takes it, writes it, and rings.
                judge.end().await;
            }
            result.send(judge).unwrap();
            Ok(())
        });
        verdict("sends", &of_judge.recv().unwrap(), &status);
    }
}

#[test]
fn a_high_receiver_never_waits_for_the_burner() {
    own_process!();
    if cannot_run() {
        return;
    }
    for looks in [0, 20] {
        let name = channel_name("high-receives");
        let burner = Burner::start();
        let _low = Program::start("low-gives", &name, Path::new(""));
        let (receiver, link) = luna_ipc::receiver::<Block>(&name).unwrap();
        let link = link.looks(looks);
        let status = link.status();
        let (result, of_judge) = std::sync::mpsc::channel();
        let (random, burnt) = (Random::new(seed()), burner.steps.clone());
        high(link, async move {
            let mut last = receiver.recv().await?;
            let mut judge = Judge::new(burnt, random);
            for _ in 1..=ROUNDS {
                judge.begin().await;
                pri_alt! {
                    value = receiver.recv() => {
                        let value = value?;
                        assert_eq!(value, block(last.number + 1));
                        last = value;
                    }
                    skip => {}
                }
                // The link acknowledges, rings, and takes the next value.
                judge.end().await;
            }
            result.send(judge).unwrap();
            Ok(())
        });
        verdict("receives", &of_judge.recv().unwrap(), &status);
    }
}

#[test]
fn a_server_inherits_its_callers_priority() {
    own_process!();
    if cannot_run() {
        return;
    }
    let name = channel_name("high-calls");
    let burner = Burner::start();
    let _low = Program::start("low-serves", &name, Path::new(""));
    let (client, link) = luna_ipc::client::<u64, u64>(&name).unwrap();
    let status = link.status();
    let (result, of_judge) = std::sync::mpsc::channel();
    let (random, burnt) = (Random::new(seed()), burner.steps.clone());
    let counts = status.clone();
    high(link, async move {
        client.call(0).await?;
        let mut judge = Judge::new(burnt, random);
        for number in 1..=ROUNDS {
            judge.begin().await;
            assert_eq!(client.call(number).await?, number + 1);
            judge.end().await;
        }
        assert_eq!(counts.refused_priorities(), 0);
        result.send(judge).unwrap();
        Ok(())
    });
    verdict("calls", &of_judge.recv().unwrap(), &status);
}
