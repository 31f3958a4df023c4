//! What the layers do when the one above is silent or gone.

use super::*;
use crate::controllers;
use crate::parameters::ROBOT;
use luna::system::Executor;

const TIME: Duration = Duration::from_secs(1);
/// A joint that is driven here.
const ARM: usize = JOINTS - 1;

fn newest<T: Send>() -> (Sender<T>, Receiver<T>) {
    luna::buffered(Buffer::overwrite_oldest(1))
}

fn system() -> (System, Executor) {
    let mut system = System::new("tulip");
    system.virtual_clock();
    let executor = system.executor("tulip").build().unwrap();
    (system, executor)
}

/// The machine and safety. Returns what the controllers see.
fn machine(executor: &Executor, commands: Receiver<Command>, left: &Arc<Left>) -> Receiver<Seen> {
    let (read, readings) = newest();
    let (see, seen) = newest();
    let (show, _) = newest();
    let (drive, drives) = newest();
    let (sight, _) = newest();
    let safety = executor.process("safety").priority(20);
    let stopped = safety.signal("safety/stopped").register().unwrap();
    let duties = safety.signal("motors/duties").register().unwrap();
    safety
        .spawn(keep_safe(
            Safety::new().unwrap(),
            (readings, commands),
            (show, see, drive),
            (stopped, duties),
            Arc::clone(left),
        ))
        .unwrap();
    let mechanics = executor.process("mechanics").priority(14);
    let signals = Signals {
        places: mechanics.signal("robot/places").register().unwrap(),
        ahead: mechanics.signal("robot/ahead").register().unwrap(),
        heights: mechanics.signal("robot/heights").register().unwrap(),
        joints: mechanics.signal("robot/joints").register().unwrap(),
    };
    mechanics
        .spawn(simulate(
            Mechanics::new(vec![]),
            TIME,
            drives,
            (read, sight),
            signals,
            Arc::clone(left),
        ))
        .unwrap();
    seen
}

/// Balance sends one set-point and ends: the joints go there.
#[test]
fn without_balance_the_joints_keep_the_last_set_point() {
    let (system, executor) = system();
    let left = Arc::default();
    let (command, commands) = luna::channel();
    let seen = machine(&executor, commands, &left);
    let (set, set_points) = newest();
    let (_law, laws) = newest();
    let joints = executor.process("joints").priority(18);
    let working = joints.signal("joints/law").register().unwrap();
    let control = JointControl {
        laws: ROBOT.each_ref().map(controllers::of),
        working: 0,
        troubles: vec![],
    };
    joints
        .spawn(control_joints(
            control,
            (seen, set_points, laws),
            command,
            working,
            Arc::clone(&left),
        ))
        .unwrap();
    let balance = executor.process("balance").priority(16);
    balance
        .spawn(async move {
            let mut last = SetPoint {
                joints: upright(),
                rates: [0.0; JOINTS],
            };
            last.joints[ARM] += 0.15;
            let _ = set.send(last).await;
            Ok(())
        })
        .unwrap();
    let report = system.run().unwrap();
    let joints = &report.loops["joints"];
    assert!(joints.cycles > 990 && joints.missed == 0, "{joints:?}");
    let findings = left.findings.get().unwrap();
    assert_eq!((findings.stopped_at, findings.fallen_at), (None, None));
    let furthest = findings.joints[ARM].range[1].to_radians() - upright()[ARM];
    assert!((0.14..0.2).contains(&furthest), "{furthest}");
}

/// The operator asks the robot to walk, and is silent from then on: it walks for a second.
#[test]
fn without_an_operator_the_robot_stands() {
    let (system, executor) = system();
    let (body, bodies) = newest();
    let (sight, sights) = newest();
    let (request, requests) = newest();
    let (wish, wishes) = newest();
    let (law, _laws) = newest();
    let (show, _shows) = newest();
    let channels = ((bodies, sights, requests), (wish, law, show));
    let world = executor.process("world model").priority(4);
    world
        .spawn(model_world(channels.0, channels.1, Arc::default()))
        .unwrap();
    let walked = Arc::new(OnceLock::new());
    let count = Arc::clone(&walked);
    let others = executor
        .process("balance, camera and operator")
        .priority(16);
    others
        .spawn(async move {
            let _ = sight.send(Vector2::new(1.0, 0.0)).await;
            let walk = Request {
                walk: true,
                law: 0,
                show: SHOW,
            };
            let _ = request.send(walk).await;
            let mut tick = luna::periodic("balance", WORLD_PERIOD)?;
            let mut latest = Wish::default();
            let mut walks = 0;
            for cycle in 0..30 {
                tick.next().await;
                take(&wishes, &mut latest);
                walks += u32::from(latest.walk);
                let now = Body {
                    time: f64::from(cycle) * WORLD_PERIOD.as_secs_f64(),
                    ..Body::default()
                };
                let _ = body.send(now).await;
            }
            assert!(!latest.walk);
            let _ = count.set(walks);
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    let walks = walked.get().copied().unwrap_or(0);
    assert!((8..=12).contains(&walks), "{walks}");
}

/// The world model has wanted the robot to walk, and ends: the gait begins, much later.
#[test]
fn without_a_world_model_the_gait_does_what_was_wanted_last() {
    let (system, executor) = system();
    let (to_gait, bodies) = newest();
    let (wish, wishes) = newest();
    let (plan, plans) = newest();
    let world = executor.process("world model").priority(4);
    world
        .spawn(async move {
            let last = Wish {
                walk: true,
                step: 0.05,
            };
            let _ = wish.send(last).await;
            Ok(())
        })
        .unwrap();
    let gait = executor.process("gait").priority(10);
    gait.spawn(walk((bodies, wishes), plan)).unwrap();
    let steps = Arc::new(OnceLock::new());
    let seen = Arc::clone(&steps);
    let balance = executor.process("balance").priority(16);
    balance
        .spawn(async move {
            let mut tick = luna::periodic("balance", GAIT_PERIOD)?;
            let mut body = Balance::default().body();
            let mut latest = Plan::Stand(Vector2::zeros());
            for cycle in 0..300 {
                tick.next().await;
                take(&plans, &mut latest);
                match latest {
                    Plan::Stand(at) => body.capture = at,
                    Plan::Step(_) => {
                        seen.get_or_init(|| cycle);
                    }
                }
                body.time = f64::from(cycle) * 0.01;
                let _ = to_gait.send(body).await;
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    assert!(steps.get().is_some_and(|cycle| *cycle > 100), "{steps:?}");
}

/// Their last command drives a motor. They hang, or have ended.
#[test]
fn without_joint_controllers_the_motors_are_off() {
    for has_ended in [false, true] {
        let (system, executor) = system();
        let left = Arc::default();
        let (command, commands) = luna::channel();
        let seen = machine(&executor, commands, &left);
        let joints = executor.process("joints").priority(18);
        joints
            .spawn(async move {
                let mut last = Command {
                    set: upright(),
                    ..Command::default()
                };
                last.duties[ARM] = 0.1;
                let _ = command.send(last).await;
                if !has_ended {
                    luna::after(TIME).await;
                }
                drop(seen);
                Ok(())
            })
            .unwrap();
        system.run().unwrap();
        let stopped = left.findings.get().unwrap().stopped_at;
        assert!(stopped.is_some_and(|at| at < 0.03), "{stopped:?}");
    }
}
