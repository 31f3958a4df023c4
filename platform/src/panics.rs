//! Whether a panic on this thread is expected, and caught by code that goes on.

use crate::on_drop::OnDrop;
use alloc::boxed::Box;
use alloc::string::String;
use core::any::Any;
use core::cell::Cell;

crate::local! {
    static ARE_CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Calls `f` and catches its panic, as [`std::panic::catch_unwind`] does, and lets the panic hook
/// [know](are_caught) that the caller does.
///
/// In a process of a system a panic is an emergency from the moment of the panic hook on, before it
/// is known that it will be caught. A panic in `f` is none: the caller gets the payload, and
/// decides. The panic hook prints it all the same. What `f` leaves half done is seen by the caller
/// alone, so no `UnwindSafe` is asked for.
///
/// ```
/// let outcome = luna_platform::panics::catch(|| u8::try_from(300).unwrap());
/// assert!(outcome.is_err());
/// ```
///
/// # Errors
///
/// The payload of the panic.
pub fn catch<R>(f: impl FnOnce() -> R) -> Result<R, Box<dyn Any + Send>> {
    let before = ARE_CAUGHT.replace(true);
    let _restore = OnDrop::new(|| ARE_CAUGHT.set(before));
    catch_unwind(f)
}

/// Calls `f` and catches its panic, as [`std::panic::catch_unwind`] does: it counts as any other
/// for the panic hook. No `UnwindSafe` is asked for, as by [`catch`]. Without `std` there is
/// nothing to be caught: a panic ends the program.
///
/// # Errors
///
/// The payload of the panic.
#[inline(always)]
pub fn catch_unwind<R>(f: impl FnOnce() -> R) -> Result<R, Box<dyn Any + Send>> {
    #[cfg(feature = "std")]
    return std::panic::catch_unwind(core::panic::AssertUnwindSafe(f));
    #[cfg(not(feature = "std"))]
    Ok(f())
}

/// Goes on with a panic that was caught.
pub fn resume(payload: Box<dyn Any + Send>) -> ! {
    #[cfg(feature = "std")]
    std::panic::resume_unwind(payload);
    #[cfg(not(feature = "std"))]
    panic!("{}", text(&*payload).unwrap_or("a panic without words"));
}

/// Whether this thread unwinds from a panic; never without `std`.
#[inline]
pub fn is_panicking() -> bool {
    #[cfg(feature = "std")]
    return std::thread::panicking();
    #[cfg(not(feature = "std"))]
    false
}

/// Ends the program at once. Without `std` by a panic that cannot be caught.
#[cold]
pub fn abort() -> ! {
    #[cfg(feature = "std")]
    std::process::abort();
    #[cfg(not(feature = "std"))]
    {
        // Where panics unwind, one in the middle of another ends the program.
        let _second = OnDrop::new(|| panic!("the program is in a state that LUNA excludes"));
        panic!("the program is in a state that LUNA excludes");
    }
}

/// The words of a panic, if they are a text.
pub fn text(payload: &(dyn Any + Send)) -> Option<&str> {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str))
}

/// Whether the calling thread is in [`catch`]. For a panic hook: also while the thread ends.
pub fn are_caught() -> bool {
    ARE_CAUGHT.get()
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn it_is_known_inside_alone() {
        assert!(!are_caught());
        let inner = catch(|| {
            assert!(are_caught());
            catch(|| panic!("on purpose")).unwrap_err();
            assert!(are_caught());
            7
        });
        assert_eq!(inner.unwrap(), 7);
        catch(|| panic!("on purpose")).unwrap_err();
        assert!(!are_caught());
    }
}
