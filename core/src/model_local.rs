//! Thread-locals that a model checker sees.

/// Thread-local variables; in a model of a model's threads, which are one thread of the system.
macro_rules! model_local {
    ($($(#[$attribute:meta])* static $name:ident: $type:ty = const $first:block;)*) => {
        #[cfg(not(loom))]
        luna_platform::local! {
            $($(#[$attribute])* static $name: $type = const $first;)*
        }
        #[cfg(loom)]
        loom::thread_local! {
            $($(#[$attribute])* static $name: $type = $first;)*
        }
    };
}
pub(crate) use model_local;
