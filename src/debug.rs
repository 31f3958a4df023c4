//! `Debug` of types that do not show all of their parts.

/// Implements `Debug`: the type's name and the listed parts, if any.
///
/// ```ignore
/// debug_parts!(TimerManager);
/// debug_parts!(Named<F> as named: name = named.name());
/// ```
macro_rules! debug_parts {
    (
        $type:ident $(<$($generic:ident),+>)? $(where [$($bound:tt)+])?
        $(as $this:ident: $($label:ident = $value:expr),+)?
    ) => {
        impl$(<$($generic),+>)? std::fmt::Debug for $type$(<$($generic),+>)?
        $(where $($bound)+)?
        {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                $(let $this = self;)?
                f.debug_struct(stringify!($type))
                    $($(.field(stringify!($label), &$value))+)?
                    .finish_non_exhaustive()
            }
        }
    };
}
