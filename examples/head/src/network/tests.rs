//! What the layers do when one beside them is silent, slow or gone.

use super::*;
use luna::report::Report;

const TIME: Duration = Duration::from_secs(1);

fn settings() -> Settings {
    Settings {
        time: TIME,
        troubles: vec![],
        policy: Policy::Other,
        place: Place::Executor,
    }
}

fn is_punctual(report: &Report) {
    for (name, cycles) in [("joints", 990), ("motion", 55)] {
        let one = &report.loops[name];
        assert!(one.cycles >= cycles && one.missed == 0, "{name}: {one:?}");
    }
}

/// The images are never taken, or vision is gone.
#[test]
fn vision_that_is_slow_or_has_ended_holds_up_no_loop() {
    for has_ended in [false, true] {
        let mut system = System::new("head");
        system.virtual_clock();
        let executor = system.executor("head").build().unwrap();
        let (image, images) = newest("images");
        let (sighting, sightings) = newest("sightings");
        let vision = (!has_ended).then_some((images, sighting));
        let head = build_head(&executor, (image, sightings), settings()).unwrap();
        is_punctual(&system.run().unwrap());
        drop(vision);
        assert!(head.findings().unwrap().stopped_at.is_none());
    }
}

/// The machine and safety, with the joint controllers or what stands for them.
struct Bench {
    system: System,
    executor: Executor,
    findings: Arc<OnceLock<Findings>>,
    shown: Receiver<Seen>,
}

/// Returns what the controllers see, too.
fn bench(duties: Receiver<[f64; AXES]>) -> (Bench, Receiver<Seen>) {
    let mut system = System::new("head");
    system.virtual_clock();
    let executor = system.executor("head").build().unwrap();
    let (read, readings) = newest("readings");
    let (see, seen) = newest("seen by joints");
    let (show, shown) = newest("seen by motion");
    let (drive, drives) = newest("drive");
    let (image, _) = newest("images");
    let safety = executor.process("safety").priority(level::SAFETY);
    let state = safety.signal("safety/stopped").register().unwrap();
    let duty = safety.signal("motors/duties").register().unwrap();
    safety
        .spawn(keep_safe(
            Safety::new().unwrap(),
            (readings, duties),
            (see, show, drive),
            (state, duty),
            Arc::default(),
        ))
        .unwrap();
    let findings = Arc::default();
    let mechanics = executor.process("mechanics").priority(level::MECHANICS);
    let signals = Signals {
        angles: mechanics.signal("head/angles").register().unwrap(),
        target: mechanics.signal("target/position").register().unwrap(),
        error: mechanics.signal("gaze/error").register().unwrap(),
    };
    mechanics
        .spawn(simulate(
            Mechanics::new(vec![]),
            TIME,
            drives,
            (read, image),
            signals,
            Arc::clone(&findings),
        ))
        .unwrap();
    let bench = Bench {
        system,
        executor,
        findings,
        shown,
    };
    (bench, seen)
}

/// The last set-point moves the pan of the neck for one cycle of motion.
#[test]
fn without_motion_control_the_joints_stand() {
    let (duty, duties) = luna::channel();
    let (bench, seen) = bench(duties);
    let (set, set_points) = newest("set-points");
    let joints = bench.executor.process("joints").priority(level::JOINTS);
    joints
        .spawn(control_joints(seen, set_points, duty))
        .unwrap();
    let motion = bench.executor.process("motion").priority(level::MOTION);
    motion
        .spawn(async move {
            let mut rates = [0.0; AXES];
            rates[1] = 0.6;
            let last = SetPoint {
                rates,
                ..SetPoint::default()
            };
            let _ = set.send(last).await;
            Ok(())
        })
        .unwrap();
    bench.system.run().unwrap();
    drop(bench.shown);
    let findings = bench.findings.get().unwrap();
    let furthest = findings.axes[1].furthest.to_radians();
    // It may overshoot. In the whole time it would go 60 times as far.
    let cycles = furthest / (0.6 * MOTION_DT);
    assert!((0.5..3.0).contains(&cycles), "{furthest}");
    assert_eq!(findings.stopped_at, None);
}

/// Their last duties drive a motor. They hang, or have ended.
#[test]
fn without_joint_controllers_the_motors_are_off() {
    for has_ended in [false, true] {
        let (duty, duties) = luna::channel();
        let (bench, seen) = bench(duties);
        let joints = bench.executor.process("joints").priority(level::JOINTS);
        joints
            .spawn(async move {
                let mut duties = [0.0; AXES];
                duties[5] = 0.1;
                let _ = duty.send(duties).await;
                if !has_ended {
                    luna::after(TIME).await;
                }
                drop(seen);
                Ok(())
            })
            .unwrap();
        bench.system.run().unwrap();
        drop(bench.shown);
        let stopped = bench.findings.get().unwrap().stopped_at;
        assert!(stopped.is_some_and(|at| at < 0.03), "{stopped:?}");
    }
}
