//! Macros: `Debug` of types that show a part of their fields, and variables of a thread or context.

/// Implements `Debug` for a type that shows these values, each by its name. A type with generics
/// lists them in `impl[…]`, as they stand behind `impl`.
///
/// ```
/// struct Door<F> {
///     width: u32,
///     on_open: F,
/// }
///
/// luna_platform::debug_fields!(impl[F: Fn()] Door<F>, |door| width: door.width);
/// let door = Door { width: 90, on_open: || () };
/// assert_eq!(format!("{door:?}"), "Door { width: 90, .. }");
/// # (door.on_open)();
/// ```
#[macro_export]
macro_rules! debug_fields {
    (
        impl[$($generics:tt)*] $type:ident $(<$($argument:tt),+>)?
        $(, |$this:ident| $($name:ident: $value:expr),+)?
    ) => {
        impl<$($generics)*> ::core::fmt::Debug for $type $(<$($argument),+>)? {
            fn fmt(&self, f: &mut ::core::fmt::Formatter<'_>) -> ::core::fmt::Result {
                $(let $this = self;)?
                f.debug_struct(::core::stringify!($type))
                    $($(.field(::core::stringify!($name), &$value))+)?
                    .finish_non_exhaustive()
            }
        }
    };
    ($type:ident $($rest:tt)*) => {
        $crate::debug_fields!(impl[] $type $($rest)*);
    };
}

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
