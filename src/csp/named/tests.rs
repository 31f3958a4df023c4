use super::*;
use luna_core::current::ExecutorId;
use std::future::poll_fn;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::task::Waker;

/// Works for `tree` on this thread as a process of its own for as long as `f` takes.
fn as_process<R>(tree: &Arc<Tree>, f: impl FnOnce(ProcessId) -> R) -> R {
    tree.enter_thread();
    let id = ProcessId::new();
    let process = Process::new(id, ExecutorId::new(), 0, 5);
    // SAFETY: the process lives as long as the closure, and waits for nothing.
    unsafe { current::with_process(&process, || f(id)) }
}

fn poll<F: Future>(future: Pin<&mut F>) -> Poll<F::Output> {
    future.poll(&mut Context::from_waker(Waker::noop()))
}

fn names(tree: &Tree) -> Vec<String> {
    let all = tree.read();
    all.iter().map(|one| one.name.to_string()).collect()
}

#[test]
fn it_is_listed_from_its_first_poll_to_its_end() {
    let tree = Tree::new();
    let mut polls = 0;
    let mut one = Box::pin(named(
        "one",
        poll_fn(|_| {
            polls += 1;
            if polls < 3 {
                Poll::Pending
            } else {
                Poll::Ready(polls)
            }
        }),
    ));
    assert_eq!(names(&tree), [""; 0]);
    as_process(&tree, |id| {
        assert!(poll(one.as_mut()).is_pending());
        let listed = tree.read();
        assert_eq!(
            (listed[0].process, listed[0].parent, listed[0].level),
            (id, 0, 5)
        );
        assert!(!listed[0].is_running);
        assert!(poll(one.as_mut()).is_pending());
        assert_eq!(names(&tree), ["one"]);
        assert_eq!(poll(one.as_mut()), Poll::Ready(3));
        assert_eq!(
            names(&tree),
            [""; 0],
            "it has ended, though it was not dropped"
        );
    });
}

#[test]
fn dropping_it_in_any_state_takes_it_off_the_list() {
    let tree = Tree::new();
    drop(named("never polled", std::future::pending::<()>()));
    as_process(&tree, |_| {
        let mut some: Vec<_> = ["a", "b", "c", "d"]
            .map(|name| Box::pin(named(name, std::future::pending::<()>())))
            .into();
        for one in &mut some {
            assert!(poll(one.as_mut()).is_pending());
        }
        assert_eq!(names(&tree), ["a", "b", "c", "d"]);
        drop(some.remove(1));
        assert_eq!(names(&tree), ["a", "c", "d"]);
        drop(some.remove(0));
        assert_eq!(names(&tree), ["c", "d"]);
        drop(some.remove(1));
        assert_eq!(names(&tree), ["c"]);
        let left = some.remove(0);
        std::thread::spawn(move || drop(left)).join().unwrap();
        assert_eq!(names(&tree), [""; 0]);
    });
}

#[test]
fn one_within_another_says_so_and_sees_it_running() {
    let tree = Tree::new();
    as_process(&tree, |_| {
        let inner = named(
            "inner",
            poll_fn(|_| {
                let all = tree.read();
                assert_eq!(all[1].parent, all[0].id);
                assert!(all.iter().all(|one| one.is_running));
                Poll::<()>::Pending
            }),
        );
        let mut outer = Box::pin(named("outer", inner));
        assert!(poll(outer.as_mut()).is_pending());
        assert_eq!(names(&tree), ["outer", "inner"]);
        let mut beside = Box::pin(named("beside", std::future::pending::<()>()));
        assert!(poll(beside.as_mut()).is_pending());
        assert_eq!(tree.read()[2].parent, 0, "the thread is in none of them");
        drop(outer);
        assert_eq!(names(&tree), ["beside"]);
    });
}

#[test]
fn one_that_is_moved_to_another_process_is_shown_there() {
    let (tree, other) = (Tree::new(), Tree::new());
    let mut one = Box::pin(named("one", std::future::pending::<()>()));
    let first = as_process(&tree, |id| {
        assert!(poll(one.as_mut()).is_pending());
        id
    });
    assert_eq!(tree.read()[0].process, first);
    let second = as_process(&tree, |id| {
        assert!(poll(one.as_mut()).is_pending());
        id
    });
    assert_eq!(tree.read()[0].process, second);
    assert_eq!(tree.read().len(), 1);
    // And to another system, on another thread.
    let one = std::thread::scope(|scope| {
        let moved = scope.spawn(|| {
            as_process(&other, |_| assert!(poll(one.as_mut()).is_pending()));
            one
        });
        moved.join().unwrap()
    });
    assert_eq!(names(&tree), [""; 0]);
    assert_eq!(names(&other), ["one"]);
    drop(one);
    assert_eq!(names(&other), [""; 0]);
}

#[test]
fn a_panic_leaves_the_thread_in_no_sub_process() {
    let tree = Tree::new();
    as_process(&tree, |_| {
        let mut bad = Box::pin(named(
            "bad",
            poll_fn(|_| -> Poll<()> { std::panic::resume_unwind(Box::new(())) }),
        ));
        assert!(catch_unwind(AssertUnwindSafe(|| poll(bad.as_mut()))).is_err());
        let mut good = Box::pin(named("good", std::future::pending::<()>()));
        assert!(poll(good.as_mut()).is_pending());
        assert_eq!(tree.read()[1].parent, 0);
        assert!(!tree.read()[0].is_running);
        drop(bad);
        assert_eq!(names(&tree), ["good"]);
    });
}

#[test]
fn without_a_system_or_a_process_it_is_the_future_alone() {
    let mut one = Box::pin(named("one", std::future::ready(7)));
    assert_eq!(poll(one.as_mut()), Poll::Ready(7));
    let tree = Tree::new();
    tree.enter_thread();
    let mut two = Box::pin(named("two", std::future::pending::<()>()));
    assert!(poll(two.as_mut()).is_pending());
    assert_eq!(names(&tree), [""; 0]);
}

#[test]
fn names_are_cut_between_characters() {
    let name = |name: &str| named(name, std::future::ready(())).name().to_owned();
    assert_eq!(name(""), "");
    assert_eq!(name("axis"), "axis");
    assert_eq!(name(&"x".repeat(63)).len(), 63);
    assert_eq!(name(&"x".repeat(64)).len(), 63);
    assert_eq!(name(&"é".repeat(40)), "é".repeat(31));
}

#[test]
fn readers_and_futures_that_come_and_go_do_not_disturb_each_other() {
    let tree = Tree::new();
    std::thread::scope(|scope| {
        for thread in 0..2 {
            let tree = &tree;
            scope.spawn(move || {
                as_process(tree, |_| {
                    let mut alive = std::collections::VecDeque::new();
                    for n in 0..2000 {
                        let mut one = Box::pin(named(
                            &format!("{thread} {n}"),
                            std::future::pending::<()>(),
                        ));
                        assert!(poll(one.as_mut()).is_pending());
                        alive.push_back(one);
                        if alive.len() > 40 {
                            // Not always the oldest.
                            alive.remove(n % 40);
                        }
                    }
                });
            });
        }
        for _ in 0..2 {
            scope.spawn(|| {
                for _ in 0..500 {
                    let all = tree.read();
                    assert!(all.len() <= 4000);
                    assert!(all.is_sorted_by_key(|one| one.id));
                    // Each name is whole, and is there once.
                    let names: std::collections::HashSet<_> =
                        all.iter().map(|one| one.name.as_str()).collect();
                    assert_eq!(names.len(), all.len());
                    assert!(names.iter().all(|name| name.split(' ').count() == 2));
                }
            });
        }
    });
    assert_eq!(names(&tree), [""; 0]);
}
