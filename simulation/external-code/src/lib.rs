//! Controllers generated as C by a tool, as processes of LUNA.
//!
//! 20-sim, Simulink and others write a sub-model as C: a function that initializes it and one that
//! computes a step, over arrays of inputs `u`, outputs `y`, states `x` and parameters `p`, at a
//! time `t`. A [`Submodel`] owns the arrays, calls the functions, and checks the outputs; a
//! [`SubmodelProcess`] does so between channels. The C is compiled by the build script of the
//! program that uses it (the `cc` crate): see `simulation/external-code/example`.
//!
//! Code with its arrays as globals (a function of `u`, `y` and `t` alone, or without arguments)
//! needs two wrapper functions of this form in C, which copy. It exists only once, so create one
//! `Submodel` of it.
//!
//! ```
//! use luna_external_code::Submodel;
//!
//! // In C: void sum_initialize(const double *u, double *y, double *x, double *p, double t),
//! // and sum_step likewise.
//! unsafe extern "C" fn sum_initialize(
//!     _u: *const f64,
//!     _y: *mut f64,
//!     x: *mut f64,
//!     p: *mut f64,
//!     _t: f64,
//! ) {
//!     // Sound: the caller passes one state and one parameter.
//!     unsafe { (*x, *p) = (0.0, 2.0) }
//! }
//! unsafe extern "C" fn sum_step(u: *const f64, y: *mut f64, x: *mut f64, p: *mut f64, _t: f64) {
//!     // Sound: the caller passes two inputs, one output, one state and one parameter.
//!     unsafe {
//!         *x += *u + *u.add(1);
//!         *y = *p * *x;
//!     }
//! }
//!
//! // Sound, since they use two inputs, one output, one state and one parameter, and nothing else.
//! let mut sum = unsafe { Submodel::<2, 1, 1, 1>::new(sum_initialize, sum_step) };
//! sum.initialize(0.0);
//! assert_eq!(sum.step([1.0, 2.0], 0.1)?, [6.0]);
//! sum.set_parameter(0, 10.0);
//! assert_eq!(sum.step([0.0, 0.5], 0.2)?, [35.0]);
//! # Ok::<(), luna_external_code::NotFinite>(())
//! ```

mod process;

pub use process::SubmodelProcess;

/// A generated function: inputs, outputs, states, parameters, and the time in seconds.
pub type Function =
    unsafe extern "C" fn(u: *const f64, y: *mut f64, x: *mut f64, p: *mut f64, t: f64);

/// An output of generated code is not a number, or infinite. It is not passed on.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("output {output} of the generated code is {value}")]
pub struct NotFinite {
    /// Which, from 0.
    pub output: usize,
    /// Its value: NaN or an infinity.
    pub value: f64,
}

impl From<NotFinite> for luna::Error {
    fn from(error: NotFinite) -> luna::Error {
        luna::Error::other(error)
    }
}

/// A generated sub-model of `U` inputs, `Y` outputs, `X` states and `P` parameters, with its
/// arrays.
///
/// Real-time path: its calls are; O(1) apart from the generated code, no allocation. The crate's
/// page has an example.
#[derive(Debug)]
pub struct Submodel<const U: usize, const Y: usize, const X: usize, const P: usize> {
    initialize: Function,
    step: Function,
    u: [f64; U],
    y: [f64; Y],
    x: [f64; X],
    p: [f64; P],
}

impl<const U: usize, const Y: usize, const X: usize, const P: usize> Submodel<U, Y, X, P> {
    /// Creates a sub-model of these two functions. All its arrays are 0 until it is initialized.
    ///
    /// # Safety
    ///
    /// On each call both functions may read `U` values at `u`, and read and write `Y`, `X` and `P`
    /// values at `y`, `x` and `p`: no others, and not after they have returned. No other code may
    /// use their globals, also no other sub-model. They may be called on any thread, and must return.
    pub const unsafe fn new(initialize: Function, step: Function) -> Self {
        Self {
            initialize,
            step,
            u: [0.0; U],
            y: [0.0; Y],
            x: [0.0; X],
            p: [0.0; P],
        }
    }

    /// Initializes it at `time`, in seconds: parameters and states get the model's values. The
    /// outputs are not checked, since not every generator computes them here.
    pub fn initialize(&mut self, time: f64) {
        self.call(self.initialize, time);
    }

    /// Computes a step with `inputs` at `time`, in seconds.
    ///
    /// # Errors
    ///
    /// An output is not finite. The states then are what the code has left.
    pub fn step(&mut self, inputs: [f64; U], time: f64) -> Result<[f64; Y], NotFinite> {
        self.u = inputs;
        // What the code leaves out was not computed.
        self.y = [f64::NAN; Y];
        self.call(self.step, time);
        match self.y.iter().position(|value| !value.is_finite()) {
            None => Ok(self.y),
            Some(output) => Err(NotFinite {
                output,
                value: self.y[output],
            }),
        }
    }

    /// The parameters, in the model's order.
    pub fn parameters(&self) -> &[f64; P] {
        &self.p
    }

    /// Changes a parameter. Call it after [`initialize`](Self::initialize), which sets them all.
    ///
    /// # Panics
    ///
    /// If there is no parameter of that number.
    #[track_caller]
    pub fn set_parameter(&mut self, number: usize, value: f64) {
        self.p[number] = value;
    }

    /// The states, in the model's order.
    pub fn states(&self) -> &[f64; X] {
        &self.x
    }

    fn call(&mut self, function: Function, time: f64) {
        let (u, y) = (self.u.as_ptr(), self.y.as_mut_ptr());
        let (x, p) = (self.x.as_mut_ptr(), self.p.as_mut_ptr());
        // SAFETY: the caller of `new` has promised that the functions access only the arrays, with
        // these lengths, and only now; and no globals that other code uses. The arrays live beyond
        // the call, and `&mut self` excludes other accesses to them.
        unsafe { function(u, y, x, p, time) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    unsafe extern "C" fn nothing(_: *const f64, y: *mut f64, _: *mut f64, _: *mut f64, _: f64) {
        // SAFETY: there are two outputs.
        unsafe { (*y, *y.add(1)) = (0.0, 0.0) }
    }

    /// Divides the first input by the second; the second output is the time.
    unsafe extern "C" fn divide(u: *const f64, y: *mut f64, _: *mut f64, _: *mut f64, t: f64) {
        // SAFETY: there are two of each.
        unsafe { (*y, *y.add(1)) = (*u / *u.add(1), t) }
    }

    unsafe extern "C" fn forgets(_: *const f64, y: *mut f64, _: *mut f64, _: *mut f64, _: f64) {
        // SAFETY: there are two outputs.
        unsafe { *y = 1.0 }
    }

    fn submodel(step: Function) -> Submodel<2, 2, 0, 0> {
        // SAFETY: the functions above use two inputs and outputs.
        unsafe { Submodel::new(nothing, step) }
    }

    #[test]
    fn an_output_that_is_not_finite_or_not_computed_is_an_error() {
        let mut divides = submodel(divide);
        assert_eq!(divides.step([1.0, 4.0], 0.5), Ok([0.25, 0.5]));
        let infinite = NotFinite {
            output: 0,
            value: f64::INFINITY,
        };
        assert_eq!(divides.step([1.0, 0.0], 0.5), Err(infinite));
        assert!(divides.step([0.0, 0.0], 0.5).unwrap_err().value.is_nan());
        let error = submodel(forgets).step([0.0; 2], 0.0).unwrap_err();
        assert_eq!(error.to_string(), "output 1 of the generated code is NaN");
    }

    #[test]
    fn as_a_process_it_raises_the_emergency_and_sends_nothing() {
        use luna::prelude::*;
        let mut system = System::new("generated");
        let main = system.executor("main").build().unwrap();
        let [(a, on_a), (b, on_b), (quotient, quotients), (time, times)] =
            std::array::from_fn(|_| luna::channel::<f64>());
        let step = Duration::from_millis(10);
        let process = SubmodelProcess::new(submodel(divide), step, [on_a, on_b], [quotient, time]);
        main.process("divider").spawn(process).unwrap();
        main.process("user")
            .spawn(async move {
                for n in 0..3 {
                    a.send(1.0).await?;
                    b.send(2.0).await?;
                    assert_eq!(quotients.recv().await?, 0.5);
                    assert!((times.recv().await? - f64::from(n) * 0.01).abs() < 1e-12);
                }
                a.send(1.0).await?;
                b.send(0.0).await?;
                assert!(quotients.recv().await.is_err());
                Ok(())
            })
            .unwrap();
        assert_eq!(
            system.run().unwrap_err().to_string(),
            "process `divider`: output 0 of the generated code is inf"
        );
        assert_eq!(system.report().unwrap().end, luna::End::Emergency);
    }

    #[test]
    fn what_is_left_over_of_one_that_fails_is_gone_before_the_emergency() {
        use luna::TryRecvError;
        use luna::prelude::*;
        use std::sync::mpsc;
        let mut system = System::new("left over");
        let main = system.executor("main").build().unwrap();
        let (a, on_a) = luna::channel::<f64>();
        let (b, on_b) = luna::channel::<f64>();
        let [(quotient, quotients), (time, times)] =
            std::array::from_fn(|_| luna::buffered::<f64>(Buffer::overwrite_oldest(1)));
        let step = Duration::from_millis(10);
        let process = SubmodelProcess::new(submodel(divide), step, [on_a, on_b], [quotient, time]);
        main.process("divider").spawn(process).unwrap();
        main.process("user")
            .spawn(async move {
                for divisor in [2.0, 0.0] {
                    a.send(1.0).await?;
                    b.send(divisor).await?;
                }
                Ok(())
            })
            .unwrap();
        let (result, results) = mpsc::channel();
        system.on_emergency("look", move || {
            for outputs in [&quotients, &times] {
                result.send(outputs.try_recv()).unwrap();
            }
        });
        system.run().unwrap_err();
        assert_eq!(system.report().unwrap().end, luna::End::Emergency);
        let seen: Vec<_> = results.try_iter().collect();
        assert_eq!(seen, [Err(TryRecvError::Poisoned); 2]);
    }
}
