//! The modes of a machine: one process decides, all others read.
// ANCHOR: rules
use luna::channel::{Client, Server, call_channel};
use luna::prelude::*;
use luna::sync::{Watch, WatchReader};
use std::time::Duration;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Idle,
    Homing,
    Run,
    Fault,
    Off,
}

#[derive(Clone, Copy, Debug)]
enum Event {
    // of the operator
    Start,
    Reset,
    SwitchOff,
    // of the axis
    Homed,
    Jammed,
}

/// All rules: the mode after an event, or none if the event is refused in this mode.
fn next(mode: Mode, event: Event) -> Option<Mode> {
    match (mode, event) {
        (Mode::Off, _) => None,
        (_, Event::SwitchOff) => Some(Mode::Off),
        (_, Event::Jammed) => Some(Mode::Fault),
        (Mode::Idle, Event::Start) => Some(Mode::Homing),
        (Mode::Homing, Event::Homed) => Some(Mode::Run),
        (Mode::Fault, Event::Reset) => Some(Mode::Idle),
        _ => None,
    }
}
// ANCHOR_END: rules

// ANCHOR: supervisor
/// Owns the mode. What the axis reports goes before a command.
async fn supervisor(
    events: Receiver<Event>,
    commands: Server<Event, Option<Mode>>,
    mode: Watch<Mode>,
) -> luna::Result<()> {
    let mut now = Mode::Idle;
    while now != Mode::Off {
        pri_alt! {
            event = events.recv() => {
                if let Some(new) = next(now, event?) {
                    now = new;
                    mode.set(now).await?;
                }
            },
            call = commands.accept() => {
                let call = call?;
                let new = next(now, *call);
                if let Some(new) = new {
                    now = new;
                    mode.set(now).await?;
                }
                let _ = call.reply(new); // an error: the caller does not wait any more
            },
        }
    }
    Ok(())
}
// ANCHOR_END: supervisor

// ANCHOR: axis
/// The loop: it reads the mode once in each cycle, and acts by it.
async fn axis(mode: Watch<Mode>, events: Sender<Event>) -> luna::Result<()> {
    let mut tick = luna::periodic("axis", Duration::from_millis(1))?;
    let mut place: f64 = 0.2;
    loop {
        tick.next().await;
        match mode.get().await? {
            Mode::Idle | Mode::Fault => {} // the motor is off
            Mode::Homing if place > 0.0 => place -= 0.01,
            Mode::Homing => {
                place = 0.0;
                events.send(Event::Homed).await?;
            }
            Mode::Run if place < 0.5 => place += 0.01,
            Mode::Run => events.send(Event::Jammed).await?, // something is in its way
            Mode::Off => return Ok(()),
        }
    }
}
// ANCHOR_END: axis

// ANCHOR: others
async fn panel(mut modes: WatchReader<Mode>) -> luna::Result<()> {
    loop {
        let mode = modes.changed().await?;
        println!("panel: {mode:?}");
        if mode == Mode::Off {
            return Ok(());
        }
    }
}

async fn operator(commands: Client<Event, Option<Mode>>) -> luna::Result<()> {
    for event in [Event::Reset, Event::Start, Event::Reset, Event::SwitchOff] {
        match commands.call(event).await? {
            Some(_) => println!("operator: {event:?}"),
            None => println!("operator: {event:?} is refused"),
        }
        luna::after(Duration::from_millis(100)).await;
    }
    Ok(())
}

fn main() -> luna::Result<()> {
    let mut system = System::new("machine");
    system.virtual_clock();
    let main = system.executor("main").build()?;
    let mode = Watch::new(Mode::Idle).named("mode");
    let (commands, server) = call_channel();
    let (events, of_axis) = luna::buffered(Buffer::fifo(4));
    let (commands, events) = (commands.named("commands"), events.named("events"));

    main.process("supervisor")
        .priority(25)
        .spawn(supervisor(of_axis, server, mode.clone()))?;
    main.process("axis")
        .priority(20)
        .spawn(axis(mode.clone(), events))?;
    main.process("panel")
        .priority(5)
        .spawn(panel(mode.reader()))?;
    main.process("operator")
        .priority(1)
        .spawn(operator(commands))?;
    system.run()?;
    Ok(())
}
// ANCHOR_END: others

// ANCHOR: test
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_left_by_a_reset_alone() {
        for event in [Event::Start, Event::Homed] {
            assert_eq!(next(Mode::Fault, event), None);
        }
        assert_eq!(next(Mode::Fault, Event::Reset), Some(Mode::Idle));
        assert_eq!(next(Mode::Run, Event::Jammed), Some(Mode::Fault));
    }
}
// ANCHOR_END: test
