use super::*;

fn error_of(outcomes: impl IntoIterator<Item = Option<Error>>) -> Option<Error> {
    let mut failures = Failures::default();
    outcomes
        .into_iter()
        .for_each(|outcome| failures.add(outcome));
    failures.take_error()
}

fn several(outcomes: impl IntoIterator<Item = Option<Error>>) -> Several {
    match error_of(outcomes) {
        Some(Error::Several(several)) => several,
        other => panic!("expected several errors, got {other:?}"),
    }
}

#[test]
fn thousands_of_branches_that_end_alike_allocate_nothing() {
    let inner = error_of((0..15_000).map(|_| Some(Error::Poisoned)));
    let several = several([inner, Some(Error::Poisoned)]);
    assert_eq!(several.len(), 15_001);
    assert!(!several.runs.spilled(), "{} runs", several.runs.len());
}

#[test]
fn none_and_one_are_not_several() {
    assert_eq!(error_of([]), None);
    assert_eq!(error_of([None, None]), None);
    assert_eq!(
        error_of([None, Some(Error::Closed), None]),
        Some(Error::Closed)
    );
    let other = Error::other("mine");
    assert_eq!(error_of([Some(other.clone())]), Some(other));
}

#[test]
fn all_kinds_come_out_in_order() {
    let all = [
        Error::Cancelled,
        Error::Panicked("a".into()),
        Error::Panicked("b".into()),
        Error::Timeout,
        Error::Poisoned,
        Error::Empty,
        Error::Full,
        Error::other("c"),
        Error::Closed,
        Error::Closed,
    ];
    // With one that ended well before each, behind each, and between none.
    for shape in 0..3 {
        let outcomes = all.iter().cloned().flat_map(|error| match shape {
            0 => vec![None, Some(error)],
            1 => vec![Some(error), None, None],
            _ => vec![Some(error)],
        });
        let several = several(outcomes);
        assert_eq!(several.len(), all.len());
        assert!(several.errors().eq(&all), "{several}");
        assert_eq!(several.first(), &Error::Cancelled);
    }
}

#[test]
fn nested_ones_stand_in_their_branch_s_place() {
    let inner = error_of([
        None,
        Some(Error::Closed),
        Some(Error::other("inner")),
        Some(Error::Closed),
    ]);
    let middle = error_of([
        inner.clone(),
        inner,
        Some(Error::Timeout),
        Some(Error::Timeout),
    ]);
    let outer = several([Some(Error::Closed), None, middle, Some(Error::Closed)]);
    assert_eq!(
        outer.to_string(),
        "10 errors in a parallel construct: branch 1: the other ends of the channel are gone; \
         branch 3.1.2: the other ends of the channel are gone; branch 3.1.3: inner; \
         branch 3.1.4: the other ends of the channel are gone; \
         branch 3.2.2: the other ends of the channel are gone; branch 3.2.3: inner; \
         branch 3.2.4: the other ends of the channel are gone; \
         branches 3.3 to 3.4: the time ran out; branch 4: the other ends of the channel are gone"
    );
    assert_eq!(outer.errors().count(), 10);
    assert_eq!(outer.errors().filter(|error| error.is_closed()).count(), 6);
}

#[test]
fn thousands_are_told_in_a_line() {
    let outcomes = (0..10_000).map(|n| (n != 2).then_some(Error::Poisoned));
    let several = several(outcomes);
    assert_eq!(several.len(), 9_999);
    let text = several.to_string();
    assert!(text.starts_with("9999 errors in a parallel construct: branches 1 to 2: "));
    assert!(text.contains("; branches 4 to 10000: "), "{text}");
}

#[test]
fn equal_if_all_are() {
    let outcomes = |last: Error| [Some(Error::Poisoned), None, Some(last)];
    assert_eq!(
        error_of(outcomes(Error::Closed)),
        error_of(outcomes(Error::Closed))
    );
    assert_ne!(
        error_of(outcomes(Error::Closed)),
        error_of(outcomes(Error::Full))
    );
    let own = Error::other("own");
    assert_eq!(
        error_of(outcomes(own.clone())),
        error_of(outcomes(own.clone()))
    );
    assert_ne!(
        error_of(outcomes(own)),
        error_of(outcomes(Error::other("own")))
    );
    // Where the branches stand matters too.
    assert_ne!(
        error_of([Some(Error::Closed), Some(Error::Closed), None]),
        error_of([Some(Error::Closed), None, Some(Error::Closed)])
    );
}
