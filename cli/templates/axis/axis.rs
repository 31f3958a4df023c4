//! The axis as processes and channels:
//!
//! ```text
//! reference ~> axis (PID) ──> safety ~> motor (simulated)
//!                ^               ^        │
//!                ╰~~~~~~~~~~~~~~~┴~~~~~~~~╯ angle
//!
//! ──> rendezvous    ~> register: the latest value
//! ```

use luna::prelude::*;
use luna_plants::{Motor, PAN, PlantLink};
use luna_safety_blocks::{Blocked, Chain, EndStop, Limit, RateLimit, Reaction, Response, Timeout};
use std::f64::consts::TAU;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);
/// The safety layer lets nothing drive the axis beyond this angle, in rad. The motor's own stops
/// are at 1.4.
pub const STOP: f64 = 1.3;

/// What the loop has seen. Written once, when it ends.
#[derive(Debug, Default)]
pub struct Outcome(Mutex<(f64, f64)>);

impl Outcome {
    /// The largest difference of reference and angle, in rad.
    pub fn largest_error(&self) -> f64 {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).0
    }

    /// How far the axis was from its middle at most, in rad.
    #[cfg_attr(not(test), expect(dead_code, reason = "the tests ask for it"))]
    pub fn furthest(&self) -> f64 {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).1
    }
}

/// Set-points that swing by `amplitude`, in rad, and an axis that follows them.
pub fn describe(
    system: &mut System,
    amplitude: f64,
    duration: Duration,
) -> luna::Result<Arc<Outcome>> {
    // On the machine `control` has a core and a real-time policy: see system.toml.
    let control = system.executor("control").build()?;
    let slow = system.executor("slow").build()?;
    let register = || luna::buffered::<f64>(Buffer::overwrite_oldest(1));
    let (reference, references) = register();
    let (measured, angles) = register();
    let (measured_too, positions) = register();
    let (wanted, asked) = luna::channel();
    let (safe, duties) = register();

    // The machine, as long as there is none. Later: a driver with the same ends.
    let mut motor = PlantLink::new("motor", Motor::new(PAN));
    motor.actuator("duty", duties)?;
    motor.sensor("angle", measured)?;
    motor.sensor("angle", measured_too)?;
    let bridge = motor.enable_line();
    system.on_emergency("bridge off", move || bridge.cut());
    let motor = motor.periodic(PERIOD)?;
    control.process("motor").priority(25).spawn(motor)?;

    // Whatever the loop does, no harmful value passes. Neutral is 0: off.
    let chain = Chain::new(0.0)?
        .then("limit", Limit::new(-1.0, 1.0)?, Reaction::Warn)?
        .then("slew", RateLimit::new(200.0)?.free_to(0.0)?, Reaction::Warn)?
        .then("stops", EndStop::new(-STOP, STOP)?, Reaction::Warn)?
        .then(
            "motion",
            Blocked::new(0.3, 2e-3, Duration::from_millis(500))?,
            Reaction::Emergency,
        )?;
    let silence = Timeout::new(Duration::from_millis(50), 0.0)?;
    let (safety, silence) = chain
        .process(asked, safe)
        .feedback(positions, Duration::from_millis(20))?
        .timeout("silence", silence, Response::new(Reaction::SafeState))?;
    control.process("safety").priority(30).spawn(safety)?;

    // Parameters are set by --set and by files. Signals are seen in the scope: LUNA_LOG=run.luna.
    let axis = control.process("axis").priority(20);
    let gain = |name, value| axis.parameter(name, value).range(0.0..=200.0).register();
    let (kp, ki, kd) = (
        gain("axis/kp", 12.0)?,
        gain("axis/ki", 20.0)?,
        gain("axis/kd", 0.3)?,
    );
    let signal = |name, unit| axis.signal::<f64>(name).unit(unit).register();
    let shown = [
        signal("axis/reference", "rad")?,
        signal("axis/angle", "rad")?,
    ];
    let shown_duty = signal("axis/duty", "1")?;
    let outcome = Arc::new(Outcome::default());
    let seen = outcome.clone();
    axis.spawn(async move {
        let mut tick = luna::periodic("axis", PERIOD)?;
        let step = tick.period().as_secs_f64();
        let (mut target, mut angle) = (0.0, 0.0);
        let (mut integral, mut last_error) = (0.0_f64, 0.0);
        let (mut largest_error, mut furthest) = (0.0_f64, 0.0_f64);
        loop {
            tick.next().await;
            match references.try_recv() {
                Ok(new) => target = new,
                Err(error) if error.is_empty() => {}
                Err(_) => break silence.retire(), // the set-points have ended: so does this
            }
            if let Ok(new) = angles.try_recv() {
                angle = new;
            }
            let error: f64 = target - angle;
            // Bounded, so that it does not grow while the axis cannot follow.
            integral = (integral + ki.get() * error * step).clamp(-0.3, 0.3);
            let duty = kp.get() * error + integral + kd.get() * (error - last_error) / step;
            last_error = error;
            largest_error = largest_error.max(error.abs());
            furthest = furthest.max(angle.abs());
            shown[0].record(target);
            shown[1].record(angle);
            shown_duty.record(duty);
            wanted.send(duty).await?;
        }
        *seen.0.lock().unwrap_or_else(PoisonError::into_inner) = (largest_error, furthest);
        Ok(())
    })?;

    slow.process("reference").spawn(async move {
        let mut tick = luna::periodic("reference", Duration::from_millis(10))?;
        let step = tick.period();
        let mut time = Duration::ZERO;
        while time < duration {
            tick.next().await;
            time += step;
            let swing = (TAU * time.as_secs_f64() / 4.0).sin(); // one in four seconds
            reference.send(amplitude * swing).await?;
        }
        Ok(())
    })?;
    Ok(outcome)
}
