//! Variables of a thread; without `std`, of a context.

/// Thread-local variables, in the syntax of `std::thread_local!` with constant first values.
/// Without an operating system each of the CPU's contexts has one of them.
///
/// ```
/// use std::cell::Cell;
///
/// luna_platform::local! {
///     static COUNT: Cell<u32> = const { Cell::new(0) };
/// }
/// COUNT.set(COUNT.get() + 1);
/// assert_eq!(COUNT.get(), 1);
/// ```
#[cfg(feature = "std")]
#[macro_export]
macro_rules! local {
    ($($all:tt)*) => { ::std::thread_local! { $($all)* } };
}

/// Variables of which each of the CPU's contexts has one, in the syntax of `std::thread_local!`
/// with constant first values.
#[cfg(not(feature = "std"))]
#[macro_export]
macro_rules! local {
    ($($(#[$attribute:meta])* $visible:vis static $name:ident: $type:ty = const $first:block;)*) => {
        $(
            $(#[$attribute])*
            $visible static $name: $crate::bare::Local<$type> =
                $crate::bare::Local::new([const $first; $crate::bare::CONTEXTS]);
        )*
    };
}
