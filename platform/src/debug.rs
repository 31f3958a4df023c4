//! `Debug` of types that show a part of their fields.

/// Implements `Debug` for a type that shows these values, each by its name.
///
/// ```
/// struct Door {
///     width: u32,
///     on_open: fn(),
/// }
///
/// luna_platform::debug_fields!(Door, |door| width: door.width);
/// let door = Door { width: 90, on_open: || () };
/// assert_eq!(format!("{door:?}"), "Door { width: 90, .. }");
/// # (door.on_open)();
/// ```
#[macro_export]
macro_rules! debug_fields {
    ($type:ident $(<$lifetime:lifetime>)?, |$this:ident| $($name:ident: $value:expr),+) => {
        impl ::core::fmt::Debug for $type $(<$lifetime>)? {
            fn fmt(&self, f: &mut ::core::fmt::Formatter<'_>) -> ::core::fmt::Result {
                let $this = self;
                f.debug_struct(::core::stringify!($type))
                    $(.field(::core::stringify!($name), &$value))+
                    .finish_non_exhaustive()
            }
        }
    };
}
