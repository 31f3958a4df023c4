//! The axis as processes and channels:
//!
//! ```text
//! reference ~> axis (PID) ──> axis safety ~> axis motor (simulated)
//!                ^               ^             │
//!                ╰~~~~~~~~~~~~~~~┴~~~~~~~~~~~~~╯ angle
//!
//! ──> rendezvous    ~> register: the latest value
//! ```
//!
//! A second axis is a second call of [`axis`], with a name and set-points of its own.

use luna::prelude::*;
use luna_plants::{Motor, PAN, PlantLink};
use luna_safety_blocks::{Blocked, Chain, EndStop, Limit, RateLimit, Reaction, Response, Timeout};
use std::f64::consts::TAU;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Of the loop and of the motor. The system file may state another one for the loop.
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
    // Where real-time scheduling is not allowed it runs all the same, and one line says what to do.
    // On the machine `control` has a core too: see system.toml.
    let control = system
        .executor("control")
        .policy(Policy::fifo(80))
        .build()?;
    let slow = system.executor("slow").build()?;
    let (reference, references) = register("axis reference");
    let outcome = axis(system, &control, "axis", references)?;

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

/// The latest value. The name is what recordings and the scope call it.
fn register(name: &str) -> (Sender<f64>, Receiver<f64>) {
    let (sender, receiver) = luna::buffered(Buffer::overwrite_oldest(1));
    (sender.named(name), receiver)
}

/// An axis that follows its set-points until they end: its loop, its safety layer, its motor.
fn axis(
    system: &mut System,
    control: &luna::Executor,
    name: &'static str,
    references: Receiver<f64>,
) -> luna::Result<Arc<Outcome>> {
    let of_axis = |what: &str| format!("{name} {what}");
    let (measured, angles) = register(&of_axis("angle"));
    let (measured_too, positions) = register(&of_axis("position"));
    let (wanted, asked) = luna::channel();
    let wanted = wanted.named(&of_axis("wanted duty"));
    let (safe, duties) = register(&of_axis("duty"));

    // The machine, as long as there is none. Later: a driver with the same ends.
    let mut motor = PlantLink::new(&of_axis("motor"), Motor::new(PAN));
    motor.actuator("duty", duties)?;
    motor.sensor("angle", measured)?;
    motor.sensor("angle", measured_too)?;
    let bridge = motor.enable_line();
    system.on_emergency(&of_axis("bridge off"), move || bridge.cut());
    let motor = motor.periodic(PERIOD)?;
    let process = control.process(of_axis("motor")).priority(25);
    process.spawn(motor)?;

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
    let process = control.process(of_axis("safety")).priority(30);
    process.spawn(safety)?;

    // Parameters are set by --set and by files. Signals are seen in the scope: LUNA_LOG=run.luna.
    let process = control.process(name).priority(20);
    let gain = |gain: &str, value| {
        let parameter = process.parameter(&format!("{name}/{gain}"), value);
        parameter.range(0.0..=200.0).register()
    };
    let (kp, ki, kd) = (gain("kp", 12.0)?, gain("ki", 20.0)?, gain("kd", 0.3)?);
    let signal = |signal: &str, unit| {
        let signal = process.signal::<f64>(&format!("{name}/{signal}"));
        signal.unit(unit).register()
    };
    let shown = [signal("reference", "rad")?, signal("angle", "rad")?];
    let shown_duty = signal("duty", "1")?;
    let outcome = Arc::new(Outcome::default());
    let seen = outcome.clone();
    process.spawn(async move {
        let mut tick = luna::periodic(name, PERIOD)?;
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
    Ok(outcome)
}
