use super::*;

fn all(branches: &mut Branches) -> Vec<usize> {
    std::iter::from_fn(|| branches.next()).collect()
}

fn wake(branches: &Branches, branch: usize) {
    branches.with_waker(branch, |cx| cx.waker().wake_by_ref());
}

#[test]
fn one_that_was_woken_comes_once_in_order() {
    for count in [0, 1, 64, 65, 4096, 4097, 10_000] {
        let mut branches = Branches::new(count);
        assert_eq!(branches.next(), None);
        branches.wake_all();
        assert!(all(&mut branches).into_iter().eq(0..count));
        let some: Vec<usize> = (0..count).filter(|n| n % 63 == 0).collect();
        some.iter().rev().for_each(|&n| wake(&branches, n));
        some.iter().for_each(|&n| wake(&branches, n));
        let mut given = all(&mut branches);
        given.sort_unstable();
        assert_eq!(given, some);
        assert_eq!(branches.next(), None);
    }
}

#[test]
fn all_take_turns() {
    let mut branches = Branches::new(10_000);
    for n in [0, 4100, 9999] {
        wake(&branches, n);
    }
    let turns: Vec<usize> = (0..9)
        .map(|_| {
            let branch = branches.next().unwrap();
            wake(&branches, branch);
            branch
        })
        .collect();
    assert_eq!(turns, [0, 4100, 9999].repeat(3));
}

#[test]
fn wakers_outlive_the_branches() {
    let mut branches = Branches::new(3);
    let wakers: Vec<Waker> = (0..3)
        .map(|n| branches.with_waker(n, |cx| cx.waker().clone()))
        .collect();
    assert!(wakers[0].will_wake(&wakers[0].clone()));
    assert!(!wakers[0].will_wake(&wakers[1]));
    wakers[2].wake_by_ref();
    assert_eq!(branches.next(), Some(2));
    branches.wait(&Context::from_waker(Waker::noop()));
    drop(branches);
    std::thread::spawn(|| wakers.into_iter().for_each(Waker::wake))
        .join()
        .unwrap();
}
