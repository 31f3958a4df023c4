//! A port for a Cortex-M with one core, from the M3 on: SysTick is the clock, `wfe` and `sev` are
//! idling and wake.
//!
//! Its resolution is that of the processor's clock. To idle it waits for the next interrupt, of
//! which SysTick is one each millisecond; it spins through the last millisecond before a deadline.
//! A port for a product arms a timer of the chip instead, and stops SysTick.
//!
//! A pending interrupt counts one millisecond. So nothing holds SysTick's handler back for a whole
//! one: no section with interrupts disabled, and no handler of its priority or a higher one. The
//! clock would go back.
//!
//! ```ignore
//! static PORT: SysTickPort = SysTickPort::new(168); // MHz
//!
//! #[exception]
//! fn SysTick() {
//!     PORT.tick();
//! }
//!
//! #[entry]
//! fn main() -> ! {
//!     // SAFETY: LUNA runs on this core, and handlers call it within `interrupt`.
//!     unsafe { PORT.start() };
//!     ...
//! }
//! ```

use core::arch::asm;
use core::cell::Cell;
use critical_section::Mutex;
use luna_platform::bare::{self, Port};
use luna_platform::clock::Instant;

const MILLISECOND: u64 = 1_000_000;

/// The registers of SysTick, and the one of the system control block that says whether it is
/// pending.
const CONTROL: *mut u32 = 0xE000_E010 as *mut u32;
const RELOAD: *mut u32 = 0xE000_E014 as *mut u32;
const CURRENT: *mut u32 = 0xE000_E018 as *mut u32;
const INTERRUPT_STATE: *const u32 = 0xE000_ED04 as *const u32;
const SYSTICK_IS_PENDING: u32 = 1 << 26;
/// It counts the processor's clock, makes interrupts, and is on.
const ON: u32 = 0b111;

/// The port on SysTick.
#[derive(Debug)]
pub struct SysTickPort {
    megahertz: u32,
    /// The milliseconds that SysTick's handler has counted.
    milliseconds: Mutex<Cell<u64>>,
}

impl SysTickPort {
    /// For a processor with this clock, from 1 to 4000 MHz.
    pub const fn new(megahertz: u32) -> Self {
        assert!(
            megahertz > 0 && megahertz <= 4000,
            "SysTick counts 24 bits, and `now` 32"
        );
        Self {
            megahertz,
            milliseconds: Mutex::new(Cell::new(0)),
        }
    }

    /// Starts SysTick, and makes this the port of the program.
    ///
    /// # Safety
    ///
    /// As [`install`](bare::install), and nothing else uses SysTick.
    pub unsafe fn start(&'static self) {
        // SAFETY: these are SysTick's registers on every Cortex-M, and nothing else uses them.
        unsafe {
            RELOAD.write_volatile(self.megahertz * 1000 - 1);
            CURRENT.write_volatile(0);
            CONTROL.write_volatile(ON);
        }
        // SAFETY: the caller promises what `install` asks for.
        unsafe { bare::install(self) };
    }

    /// To be called by the handler of SysTick, first. Nothing is to hold that back for a
    /// millisecond: see the module.
    pub fn tick(&self) {
        critical_section::with(|section| {
            let milliseconds = self.milliseconds.borrow(section);
            milliseconds.set(milliseconds.get() + 1);
        });
    }
}

impl Port for SysTickPort {
    fn now(&self) -> u64 {
        critical_section::with(|section| {
            let mut milliseconds = self.milliseconds.borrow(section).get();
            // SAFETY: reading these registers has no effect.
            let (mut left, state) =
                unsafe { (CURRENT.read_volatile(), INTERRUPT_STATE.read_volatile()) };
            if state & SYSTICK_IS_PENDING != 0 {
                // It began anew, and its handler was held back.
                milliseconds += 1;
                // SAFETY: as above.
                left = unsafe { CURRENT.read_volatile() };
            }
            // 32 bits, which the processor divides by itself: less than 4000 million.
            let passed = (self.megahertz * 1000 - 1 - left) * 1000 / self.megahertz;
            milliseconds * MILLISECOND + u64::from(passed)
        })
    }

    fn idle(&self, deadline: Instant) {
        if deadline.as_nanos().saturating_sub(self.now()) < MILLISECOND {
            // The caller looks again until then.
            return;
        }
        // SAFETY: it waits for an event: an interrupt, or `sev`, also one that came before. Not
        // `nomem`: what the caller read before is not read later, nor the reverse.
        unsafe { asm!("wfe", options(nostack, preserves_flags)) };
    }

    fn wake(&self) {
        // SAFETY: it makes an event. Not `nomem`: what was written before is written by then.
        unsafe { asm!("sev", options(nostack, preserves_flags)) };
    }

    fn is_interrupt(&self) -> bool {
        let number: u32;
        // SAFETY: it reads the number of the running exception; 0 is none.
        unsafe {
            asm!("mrs {}, ipsr", out(reg) number, options(nomem, nostack, preserves_flags));
        }
        number & 0x1ff != 0
    }
}

/// The critical section of one core: its interrupts are disabled. It is that of the crate
/// `cortex-m` with the feature `critical-section-single-core`, to be used where that is there
/// anyway.
struct InterruptsDisabled;
critical_section::set_impl!(InterruptsDisabled);

// SAFETY: with its interrupts disabled, the one core runs nothing else.
unsafe impl critical_section::Impl for InterruptsDisabled {
    unsafe fn acquire() -> bool {
        let disabled: u32;
        // SAFETY: reads whether interrupts are disabled, and disables them. Not `nomem`: what
        // follows stays behind it.
        unsafe {
            asm!("mrs {}, primask", "cpsid i", out(reg) disabled, options(nostack, preserves_flags));
        }
        disabled & 1 != 0
    }

    unsafe fn release(were_disabled: bool) {
        if !were_disabled {
            // SAFETY: `acquire` has disabled them. Not `nomem`: what came before stays before it.
            unsafe { asm!("cpsie i", options(nostack, preserves_flags)) };
        }
    }
}
