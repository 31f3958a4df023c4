//! `alt!` and `pri_alt!`.

/// Offers several operations, of which exactly one happens. The choice is fair: of the ready
/// guards, it takes the one with the least recently chosen channel end.
///
/// ```text
/// alt! {
///     pattern = guard => body,
///     pattern = guard, if precondition => body,
///     skip => body                                  // last: when nothing else is ready now
/// }
/// ```
///
/// A *guard* is a `recv()`, `recv_extended()`, `send(..)`, `send_from(..)`, `send_with(..)`, a
/// barrier's `sync()`, a delay ([`after`](crate::after), [`at`](crate::at)), or `skip`. The value
/// of the alternative is that of the body that runs. Bodies run after all guards are gone, so they
/// may use what the guards borrowed; `?`, `return`, `break` and `.await` work in them.
///
/// - A guard is not evaluated if its precondition is false. With no guard open and no `skip` an
///   alternative is STOP: it waits for ever.
/// - A channel that has ended is ready, and gives its error.
/// - Fair are the ends of channels, the barriers, ticks and watchdogs. A delay (`after`, `at`) that
///   has passed has no memory of having been chosen, and comes first; before the instant of its
///   deadline it is not ready.
/// - All preconditions are evaluated first, then the guards that are open, each in the order
///   written.
/// - Input guards are `recv()`, `recv_extended()` and a server's `accept()`. A client's `call(..)`
///   is chosen when a server accepts it: a delay beside it bounds the wait for the server, not for
///   the reply.
/// - A value offered with `send(value)` that is not chosen is dropped; `send_from` keeps it in its
///   slot, `send_with` makes it only when chosen.
/// - One channel may stand in several guards: an alternative never communicates with itself. Two
///   that offer each other opposite ends do.
///
/// Cancel-safe: dropped while it waits it leaves no trace. Real-time path: yes; no allocation; for
/// n guards, at most 32, n locks and O(n²) steps, to wait also each waiting list's O(those of
/// lower priority), and one step for each stale offer of another alternative. The choice is made
/// under the locks of all channels, taken in the order of their addresses.
///
/// ```
/// use luna_channels::{alt, channel};
/// # luna_core::block_on(async {
/// let (numbers, from_numbers) = channel();
/// let (_words, from_words) = channel::<&str>();
/// let thread = std::thread::spawn(move || numbers.blocking_send(7));
/// let text = alt! {
///     number = from_numbers.recv() => format!("{}", number.unwrap()),
///     word = from_words.recv() => word.unwrap().to_owned(),
/// };
/// assert_eq!(text, "7");
/// # thread.join().unwrap().unwrap();
/// # }).unwrap();
/// ```
#[doc(alias = "select")]
#[macro_export]
macro_rules! alt {
    ($($branches:tt)*) => { $crate::__alternative!(@parse true [] $($branches)*) };
}

/// Like [`alt!`], but of the ready guards the first in the order written happens.
///
/// Exact, also across cores: if a guard was ready strictly before a lower one, it is the one that
/// happens.
///
/// ```
/// use luna_channels::{Buffer, buffered, pri_alt};
/// # luna_core::block_on(async {
/// let (stop, stopped) = buffered(Buffer::fifo(1));
/// let (work, worker) = buffered(Buffer::fifo(1));
/// work.try_send(1).unwrap();
/// stop.try_send(()).unwrap();
/// let first = pri_alt! {
///     _ = stopped.recv() => "stop",
///     _ = worker.recv() => "work",
/// };
/// assert_eq!(first, "stop");
/// let polled = pri_alt! {
///     _ = stopped.recv() => true,
///     skip => false,
/// };
/// assert!(!polled);
/// # }).unwrap();
/// ```
#[macro_export]
macro_rules! pri_alt {
    ($($branches:tt)*) => { $crate::__alternative!(@parse false [] $($branches)*) };
}

/// Takes the branches one by one off its input, each to
/// `{[pattern] [guard] [precondition] [body]}`, then makes of them a list of guards to choose from,
/// and a match on what was chosen.
#[doc(hidden)]
#[macro_export]
macro_rules! __alternative {
    // `skip` comes last. (A path of one segment called `skip` would be a pattern without a guard
    // anyway.)
    (@parse $fair:tt [$($done:tt)*] skip => $body:block $(,)?) => {
        $crate::__alternative!(@emit $fair [$($done)*] [{$body}])
    };
    (@parse $fair:tt [$($done:tt)*] skip => $body:expr $(,)?) => {
        $crate::__alternative!(@emit $fair [$($done)*] [{$body}])
    };
    (@parse $fair:tt [$($done:tt)*] skip => $($rest:tt)*) => {
        ::core::compile_error!("`skip` must be the last branch of an alternative")
    };
    (@parse $fair:tt [$($done:tt)*] skip, if $($rest:tt)*) => {
        ::core::compile_error!("`skip` takes no precondition")
    };
    (@parse $fair:tt []) => { ::core::compile_error!("an alternative needs at least one guard") };
    (@parse $fair:tt [$($done:tt)+]) => { $crate::__alternative!(@emit $fair [$($done)+] []) };

    // As in the macros of other runtimes, where such a branch is left out if its pattern does not
    // match. Here a guard that happened cannot be undone.
    (@parse $fair:tt [$($done:tt)*] Ok($($value:tt)*) = $($rest:tt)*) => {
        $crate::__alternative!(@refutable Ok($($value)*))
    };
    (@parse $fair:tt [$($done:tt)*] Err($($value:tt)*) = $($rest:tt)*) => {
        $crate::__alternative!(@refutable Err($($value)*))
    };
    (@parse $fair:tt [$($done:tt)*] Some($($value:tt)*) = $($rest:tt)*) => {
        $crate::__alternative!(@refutable Some($($value)*))
    };
    (@refutable $($pattern:tt)*) => {
        ::core::compile_error!(::core::concat!(
            "the pattern `", ::core::stringify!($($pattern)*), "` does not match every outcome, ",
            "and a guard that has happened is not undone: write `result = guard => match result ",
            "{ Ok(value) => .., Err(error) => .. }`, or `result = guard => { let value = result?; .. }`"
        ))
    };

    // A guard with a precondition, and one without. A body that is a block needs no comma.
    (@parse $fair:tt [$($done:tt)*] $pattern:pat = $guard:expr, if $condition:expr => $body:block, $($rest:tt)*) => {
        $crate::__alternative!(@parse $fair [$($done)* {[$pattern] [$guard] [$condition] [$body]}] $($rest)*)
    };
    (@parse $fair:tt [$($done:tt)*] $pattern:pat = $guard:expr, if $condition:expr => $body:block $($rest:tt)*) => {
        $crate::__alternative!(@parse $fair [$($done)* {[$pattern] [$guard] [$condition] [$body]}] $($rest)*)
    };
    (@parse $fair:tt [$($done:tt)*] $pattern:pat = $guard:expr, if $condition:expr => $body:expr $(, $($rest:tt)*)?) => {
        $crate::__alternative!(@parse $fair [$($done)* {[$pattern] [$guard] [$condition] [$body]}] $($($rest)*)?)
    };
    (@parse $fair:tt [$($done:tt)*] $pattern:pat = $guard:expr => $body:block, $($rest:tt)*) => {
        $crate::__alternative!(@parse $fair [$($done)* {[$pattern] [$guard] [] [$body]}] $($rest)*)
    };
    (@parse $fair:tt [$($done:tt)*] $pattern:pat = $guard:expr => $body:block $($rest:tt)*) => {
        $crate::__alternative!(@parse $fair [$($done)* {[$pattern] [$guard] [] [$body]}] $($rest)*)
    };
    (@parse $fair:tt [$($done:tt)*] $pattern:pat = $guard:expr => $body:expr $(, $($rest:tt)*)?) => {
        $crate::__alternative!(@parse $fair [$($done)* {[$pattern] [$guard] [] [$body]}] $($($rest)*)?)
    };

    (@parse $fair:tt [$($done:tt)*] $($rest:tt)+) => {
        ::core::compile_error!(
            "a branch is `pattern = guard => body` or `pattern = guard, if condition => body`, the last one may be `skip => body`; after a body that is no block comes a comma"
        )
    };

    // The guards live and die in the first statement; bodies run after it.
    (@emit $fair:tt [$($branches:tt)*] [$($skip:tt)*]) => {{
        let conditions = $crate::__alternative!(@conditions $($branches)*);
        let chosen = $crate::__alternative!(@guards $fair [conditions] [$($skip)*] [] $($branches)*);
        $crate::__alternative!(@bodies chosen [$($skip)*] $($branches)*)
    }};

    // A list of them, in the order of the guards.
    (@conditions) => { () };
    (@conditions {[$pattern:pat] [$guard:expr] [] [$body:expr]} $($rest:tt)*) => {
        (true, $crate::__alternative!(@conditions $($rest)*))
    };
    (@conditions {[$pattern:pat] [$guard:expr] [$condition:expr] [$body:expr]} $($rest:tt)*) => {
        ($condition, $crate::__alternative!(@conditions $($rest)*))
    };

    // Each guard is pinned in a block around that of the next one, and the innermost block chooses.
    // A `match`, since what a guard's expression borrows is to live as long as the guard.
    (@guards $fair:tt [$($conditions:tt)*] [$($skip:tt)*] [$($guards:ident)*] {[$pattern:pat] [$guard:expr] [] [$body:expr]} $($rest:tt)*) => {
        match $crate::__private::guard($guard) {
            seed => {
                let mut guard = ::core::pin::pin!($crate::__private::Place::empty());
                // SAFETY: the place is new, and only this expansion knows it.
                unsafe { guard.as_mut().plant(::core::option::Option::Some(seed)) };
                $crate::__alternative!(@guards $fair [$($conditions)*.1] [$($skip)*] [$($guards)* guard] $($rest)*)
            }
        }
    };
    (@guards $fair:tt [$($conditions:tt)*] [$($skip:tt)*] [$($guards:ident)*] {[$pattern:pat] [$guard:expr] [$condition:expr] [$body:expr]} $($rest:tt)*) => {
        match if $($conditions)*.0 {
            ::core::option::Option::Some($crate::__private::guard($guard))
        } else {
            ::core::option::Option::None
        } {
            seed => {
                let mut guard = ::core::pin::pin!($crate::__private::Place::empty());
                // SAFETY: the place is new, and only this expansion knows it.
                unsafe { guard.as_mut().plant(seed) };
                $crate::__alternative!(@guards $fair [$($conditions)*.1] [$($skip)*] [$($guards)* guard] $($rest)*)
            }
        }
    };
    (@guards $fair:tt [$($conditions:tt)*] [$($skip:tt)*] [$($guards:ident)*]) => {{
        let () = $($conditions)*;
        let has_skip = $crate::__alternative!(@has_skip $($skip)*);
        let number = {
            // SAFETY: each guard is offered once, here.
            let offers = &mut unsafe { [$($guards.as_mut().offer()),*] };
            // SAFETY: they are offered to this choice alone, which is over or dropped before them.
            unsafe { $crate::__private::choose(offers, $fair, has_skip) }.await
        };
        // SAFETY: the choice is over, and dropped.
        $(unsafe { $guards.as_mut().decided() };)*
        $crate::__alternative!(@output number [$($skip)*] $($guards)*)
    }};

    (@has_skip) => { false };
    (@has_skip {$skip:expr}) => { true };

    (@output $number:ident []) => {
        $crate::__private::no_guard($number)
    };
    (@output $number:ident [{$skip:expr}]) => {{
        let _ = $number;
    }};
    (@output $number:ident [$($skip:tt)*] $guard:ident $($rest:ident)*) => {
        if $number == 0 {
            // SAFETY: the choice has given this guard's number, and the output is taken once.
            $crate::__private::Either::L(unsafe { $guard.as_mut().output() })
        } else {
            let number = $number - 1;
            $crate::__private::Either::R($crate::__alternative!(@output number [$($skip)*] $($rest)*))
        }
    };

    (@bodies $chosen:ident []) => { match $chosen {} };
    (@bodies $chosen:ident [{$skip:expr}]) => {{
        let () = $chosen;
        $skip
    }};
    (@bodies $chosen:ident [$($skip:tt)*] {[$pattern:pat] [$guard:expr] [$($condition:expr)?] [$body:expr]} $($rest:tt)*) => {
        match $chosen {
            $crate::__private::Either::L($pattern) => $body,
            $crate::__private::Either::R(rest) => {
                $crate::__alternative!(@bodies rest [$($skip)*] $($rest)*)
            }
        }
    };
}
