use super::*;
use luna_channels::inspect::{WaitPointKind, Waiting, wait_points};
use std::panic::Location;

fn ids<const N: usize>() -> [ProcessId; N] {
    std::array::from_fn(|_| ProcessId::new())
}

fn processes(ids: &[ProcessId]) -> Vec<Sleeping> {
    let named = ids.iter().zip('a'..='z');
    named
        .map(|(&id, name)| Sleeping {
            id,
            name: name.to_string().into(),
            has_ended: false,
            joiners: Vec::new(),
        })
        .collect()
}

/// A channel with ends that were last used by these.
#[track_caller]
fn channel(name: &str, sender: Option<User>, receiver: Option<User>) -> WaitPointView {
    let _ends = luna_channels::channel::<u8>();
    let mut view = wait_points().pop().expect("there is at least this channel");
    view.kind = WaitPointKind::Rendezvous;
    view.address = 0;
    view.name = Some(name.to_owned());
    view.made_at = Location::caller();
    (view.buffered, view.external, view.strangers, view.ended) = (0, false, false, false);
    (view.sender, view.receiver) = (sender, receiver);
    view.waiting = Vec::new();
    view
}

trait Waits {
    fn waits(self, id: ProcessId, sends: bool) -> Self;
}

impl Waits for WaitPointView {
    fn waits(mut self, id: ProcessId, sends: bool) -> Self {
        let role = if sends { Role::Sender } else { Role::Receiver };
        self.waiting.push(Waiting::new(User::Process(id), role));
        self
    }
}

fn used_by(id: ProcessId) -> Option<User> {
    Some(User::Process(id))
}

#[test]
fn two_that_receive_from_each_other_first() {
    let [a, b] = ids();
    let points = [
        channel("to a", used_by(b), used_by(a)).waits(a, false),
        channel("to b", used_by(a), used_by(b)).waits(b, false),
    ];
    let found = find("s", &processes(&[a, b]), &points, |_| false, |_, _| false).unwrap();
    assert_eq!(found.cycle, ["a", "b"]);
    assert_eq!(
        found.to_string(),
        "system `s` is deadlocked: every process waits, and nothing that the system knows of can wake one\n  \
         `a` waits to receive from channel `to a` for `b`, which used its other end last\n  \
         `b` waits to receive from channel `to b` for `a`, which used its other end last\n  \
         a circle: `a` waits to receive from channel `to a` for `b`, which waits to receive from channel `to b` for `a`\n  \
         each of them receives first: let one send first"
    );
}

#[test]
fn a_sender_waits_for_the_one_that_received_last() {
    let [a, b] = ids();
    let points = [
        channel("x", used_by(a), used_by(b)).waits(a, true),
        channel("y", used_by(b), used_by(a)).waits(b, true),
    ];
    let found = find("s", &processes(&[a, b]), &points, |_| false, |_, _| false).unwrap();
    assert_eq!(found.waits[0].operation, Operation::Send);
    assert_eq!(found.waits[0].partner, Partner::Process("b".to_owned()));
    assert_eq!(found.cycle, ["a", "b"]);
}

/// The other ends are unused; the bodies have them in them.
#[test]
fn two_that_send_to_each_other_first() {
    let [a, b] = ids();
    let at = |address, mut wait_point: WaitPointView| {
        wait_point.address = address;
        wait_point
    };
    let points = [
        at(1, channel("to b", used_by(a), None).waits(a, true)),
        at(2, channel("to a", used_by(b), None).waits(b, true)),
    ];
    // Both have both channels: one to send, and the other to receive.
    let find = |refers: fn(ProcessId, usize) -> bool| {
        find("s", &processes(&[a, b]), &points, |_| false, refers).unwrap()
    };
    let found = find(|_, address| address == 1 || address == 2);
    assert_eq!(
        found.waits[0].partner,
        Partner::Holders(vec!["b".to_owned()])
    );
    assert_eq!(found.cycle, ["a", "b"]);
    assert_eq!(
        found.to_string(),
        "system `s` is deadlocked: every process waits, and nothing that the system knows of can wake one\n  \
         `a` waits to send to channel `to b`, whose other end nobody has used yet; `b` appears to hold it\n  \
         `b` waits to send to channel `to a`, whose other end nobody has used yet; `a` appears to hold it\n  \
         a circle: `a` waits to send to channel `to b` for `b`, which waits to send to channel `to a` for `a`\n  \
         each of them sends first: let one receive first, or give one of the channels a buffer"
    );
    let unknown = find(|_, _| false);
    assert_eq!(
        (&unknown.waits[0].partner, unknown.cycle.len()),
        (&Partner::Nobody, 0)
    );
    assert!(unknown.to_string().contains("external()"), "{unknown}");
}

#[test]
fn several_may_hold_an_end_but_not_that_has_ended() {
    let [a, b, c, d] = ids();
    let mut all = processes(&[a, b, c, d]);
    all[3].has_ended = true;
    let points = [
        channel("x", used_by(a), None).waits(a, true),
        channel("y", used_by(a), None).waits(b, false),
        channel("z", used_by(a), None).waits(c, false),
    ];
    let found = find("s", &all, &points, |_| false, |_, _| true).unwrap();
    let both = vec!["b".to_owned(), "c".to_owned()];
    assert_eq!(found.waits[0].partner, Partner::Holders(both));
    let text = found.to_string();
    assert!(
        text.contains("; one of `b`, `c` appears to hold it"),
        "{text}"
    );
}

#[test]
fn one_that_waits_beside_the_circle_is_not_in_it() {
    let [a, b, c] = ids();
    let points = [
        channel("1", used_by(b), None).waits(a, false),
        channel("2", used_by(c), None).waits(b, false),
        channel("3", used_by(b), None).waits(c, false),
    ];
    let found = find(
        "s",
        &processes(&[a, b, c]),
        &points,
        |_| false,
        |_, _| false,
    )
    .unwrap();
    assert_eq!(found.cycle, ["b", "c"]);
    assert_eq!(found.waits.len(), 3);
}

#[test]
fn the_circle_may_go_by_any_guard_of_an_alternative() {
    let [a, b] = ids();
    let points = [
        channel("unused", None, None).waits(a, false),
        channel("back", used_by(b), None).waits(a, false),
        channel("forth", used_by(a), None).waits(b, false),
    ];
    let found = find("s", &processes(&[a, b]), &points, |_| false, |_, _| false).unwrap();
    assert_eq!(found.cycle, ["a", "b"]);
    let text = found.to_string();
    assert!(
        text.contains(
            "`a` waits to receive from channel `unused`, whose other end nobody has used yet"
        ),
        "{text}"
    );
    assert!(text.contains("external()"), "{text}");
}

#[test]
fn one_that_waits_for_itself_is_a_circle() {
    let [a] = ids();
    let points = [channel("own", used_by(a), None).waits(a, false)];
    let found = find("s", &processes(&[a]), &points, |_| false, |_, _| false).unwrap();
    assert_eq!(found.cycle, ["a"]);
    assert!(
        found
            .to_string()
            .contains("whose other end it used last itself"),
        "{found}"
    );
}

#[test]
fn without_a_known_partner_there_is_no_circle() {
    let [a, b] = ids();
    let mut all = processes(&[a, b]);
    all[1].has_ended = true;
    let points = [channel("x", used_by(b), None).waits(a, false)];
    let found = find("s", &all, &points, |_| false, |_, _| false).unwrap();
    assert_eq!(found.waits[0].partner, Partner::Ended("b".to_owned()));
    assert_eq!(found.cycle, [""; 0]);
    assert_eq!(found.waits.len(), 1, "the ended one waits for nothing");
}

#[test]
fn a_system_whose_processes_have_all_ended_is_not_deadlocked() {
    let [a] = ids();
    let mut all = processes(&[a]);
    all[0].has_ended = true;
    assert_eq!(find("s", &all, &[], |_| false, |_, _| false), None);
    assert_eq!(find("s", &[], &[], |_| false, |_, _| false), None);
}

#[test]
fn joining_is_waiting() {
    let [a, b] = ids();
    let mut all = processes(&[a, b]);
    all[1].joiners = vec![a];
    let points = [channel("x", used_by(a), None).waits(b, false)];
    let found = find("s", &all, &points, |_| false, |_, _| false).unwrap();
    assert_eq!(found.cycle, ["a", "b"]);
    assert!(
        found.to_string().contains("`a` waits for the end of `b`"),
        "{found}"
    );
}

#[test]
fn at_a_barrier_one_waits_for_those_that_have_not_come() {
    let [a] = ids();
    let mut barrier = channel("start", None, None).waits(a, false);
    barrier.kind = WaitPointKind::Barrier;
    barrier.waiting[0].role = Role::Party;
    let mut with_strangers = barrier.clone();
    with_strangers.strangers = true;
    assert_eq!(
        find(
            "s",
            &processes(&[a]),
            &[with_strangers],
            |_| false,
            |_, _| false
        ),
        None
    );
    let found = find("s", &processes(&[a]), &[barrier], |_| false, |_, _| false).unwrap();
    assert!(
        found
            .to_string()
            .contains("`a` waits at barrier `start` for parties that have not come"),
        "{found}"
    );
}

#[test]
fn whatever_may_be_woken_from_outside_is_no_deadlock() {
    let [a, b, stranger] = ids();
    let all = processes(&[a, b]);
    let other = channel("x", used_by(a), None).waits(b, false);
    let is_deadlock = |wait_point: WaitPointView| {
        find(
            "s",
            &all,
            &[wait_point, other.clone()],
            |_| false,
            |_, _| false,
        )
        .is_some()
    };
    assert!(is_deadlock(channel("y", used_by(b), None).waits(a, false)));
    // A plain thread was the last to use the other end.
    assert!(!is_deadlock(
        channel("y", Some(User::Outside), None).waits(a, false)
    ));
    assert!(!is_deadlock(
        channel("y", None, Some(User::Outside)).waits(a, true)
    ));
    // A process of another system.
    assert!(!is_deadlock(
        channel("y", used_by(stranger), None).waits(a, false)
    ));
    // Marked.
    let mut marked = channel("y", used_by(b), None).waits(a, false);
    marked.external = true;
    assert!(!is_deadlock(marked));
    // `a` waits for something that is no channel.
    assert!(!is_deadlock(channel("y", used_by(b), None)));
}

#[test]
fn an_outside_user_of_its_own_end_does_not_help() {
    let [a] = ids();
    let points = [channel("x", used_by(a), Some(User::Outside)).waits(a, false)];
    assert!(find("s", &processes(&[a]), &points, |_| false, |_, _| false).is_some());
}

#[test]
fn circles_of_random_graphs_are_circles() {
    let seed = std::env::var("LUNA_SEED")
        .ok()
        .and_then(|seed| seed.parse().ok())
        .unwrap_or(0x5eed_u64);
    println!("LUNA_SEED={seed}");
    let mut state = seed | 1;
    let mut below = move |end: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % end as u64) as usize
    };
    for _ in 0..2000 {
        let count = 1 + below(7);
        let edges: Vec<(usize, usize)> = (0..below(10))
            .map(|_| (below(count), below(count)))
            .collect();
        let mut from_each = vec![Vec::new(); count];
        for &(from, to) in &edges {
            from_each[from].push(to);
        }
        let found = cycle(&from_each);
        let reaches = |from: usize, to: usize| {
            let mut seen = vec![false; count];
            let mut open = vec![from];
            while let Some(at) = open.pop() {
                for &(one, next) in &edges {
                    if one == at && !std::mem::replace(&mut seen[next], true) {
                        open.push(next);
                    }
                }
            }
            seen[to]
        };
        let has_cycle = (0..count).any(|one| reaches(one, one));
        assert_eq!(!found.is_empty(), has_cycle, "{edges:?}");
        for (place, &from) in found.iter().enumerate() {
            let to = found[(place + 1) % found.len()];
            assert!(edges.contains(&(from, to)), "{edges:?} {found:?}");
        }
    }
}
