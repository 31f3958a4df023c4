//! The base itself. It knows nothing of ROS 2, so it is tested without.

use luna::prelude::*;
use std::time::Duration;

/// Of the loop, also in the tests. The system file may state another one.
pub const PERIOD: Duration = Duration::from_millis(1);
/// Without a new command for so long, it stops.
pub const SILENCE: Duration = Duration::from_millis(200);
/// Of a wheel, and half of the distance between the two, in metres.
const RADIUS: f64 = 0.05;
const HALF_TRACK: f64 = 0.15;

/// How the base is to move: m/s ahead, and rad/s to the left.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Command {
    pub ahead: f64,
    pub turn: f64,
}

/// The left and the right wheel: rad, and rad/s.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Wheels {
    pub angles: [f64; 2],
    pub speeds: [f64; 2],
}

/// The other ends of the base's channels.
pub struct Ends {
    pub commands: Sender<Command>,
    pub wheels: Receiver<Wheels>,
}

pub fn describe(system: &mut System, duration: Duration) -> luna::Result<Ends> {
    // Where real-time scheduling is not allowed it runs all the same, and one line says what to do.
    // On the machine `control` has a core too: see system.toml.
    let control = system
        .executor("control")
        .policy(Policy::fifo(80))
        .build()?;
    // Registers: the loop never waits, and each reader gets the latest value.
    let (commands, received) = luna::buffered::<Command>(Buffer::overwrite_oldest(1));
    let (state, wheels) = luna::buffered::<Wheels>(Buffer::overwrite_oldest(1));
    let (commands, state) = (commands.named("commands"), state.named("wheels"));
    control.process("drive").priority(20).spawn(async move {
        let mut tick = luna::periodic("drive", PERIOD)?;
        let (mut command, mut wheels) = (Command::default(), Wheels::default());
        let (begin, mut last, mut commanded) = (luna::now(), luna::now(), luna::now());
        while last - begin < duration {
            tick.next().await;
            // The time that has passed, also when slots were missed.
            let now = luna::now();
            let step = now - last;
            last = now;
            // Without a bridge nobody sends: then there are no commands.
            if let Ok(new) = received.try_recv() {
                (command, commanded) = (new, now);
            }
            if now - commanded >= SILENCE {
                command = Command::default();
            }
            let turn = command.turn * HALF_TRACK;
            wheels.speeds =
                [command.ahead - turn, command.ahead + turn].map(|speed| speed / RADIUS);
            for (angle, speed) in wheels.angles.iter_mut().zip(wheels.speeds) {
                *angle += speed * step.as_secs_f64();
            }
            // Nobody may read it any more: then the base goes on alone.
            let _ = state.send(wheels).await;
        }
        Ok(())
    })?;
    Ok(Ends { commands, wheels })
}
