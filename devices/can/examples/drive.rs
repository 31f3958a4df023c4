//! A CANopen drive, simulated: it is set up by SDO, started by NMT, and positioned over PDOs with
//! every SYNC; then its cable breaks, and the missed heartbeat is an emergency. The example ends by
//! itself with a verdict.

use luna::prelude::*;
use luna::{Buffer, End};
use luna_can::canopen::sim::{Access, Node, NodeControl};
use luna_can::canopen::{
    Direction, Network, NmtCommand, NodeEvent, NodeId, Object, OnMissed, PdoSetting, Transmission,
};
use luna_can::{Port, sim};
use std::sync::mpsc;
use std::time::Duration;

const STATUS: Object = Object::new(0x6041, 0);
const CONTROL: Object = Object::new(0x6040, 0);
const POSITION: Object = Object::new(0x6064, 0);
const TARGET: Object = Object::new(0x607A, 0);
const PERIOD: Duration = Duration::from_millis(5);
const GOAL: i32 = 20_000;

fn main() -> luna::Result<()> {
    let mut system = System::new("axis");
    system.virtual_clock();
    let mut bus = sim::Bus::new(1_000_000)?;
    let breaks = bus.control();
    // In place of this: luna_can::open(&system.devices(), "can0").
    let master = bus.open(&system.devices(), "master")?;
    let simulated = bus.open(&system.devices(), "drive")?;
    let stop = NmtCommand::Stop.frame(None);
    master.on_emergency("stop all nodes", move |port| {
        port.transmit_at_once(stop).expect("the stop was not sent");
    })?;
    let main = system.executor("main").build()?;
    main.process("bus").spawn(bus)?;

    let id = NodeId::new(5).ok_or(luna::Error::other("no node"))?;
    let (from_drive, to_drive) = (0x185, 0x205);
    let node = Node::new(&simulated, id)
        .object(STATUS, 0_u16, Access::ReadOnly)
        .object(CONTROL, 0_u16, Access::ReadWrite)
        .object(POSITION, 0_i32, Access::ReadOnly)
        .object(TARGET, 0_i32, Access::ReadWrite)
        .heartbeat(50);
    let motor = node.control();
    main.process("drive").spawn(node)?;
    main.process("motor").spawn(move_motor(motor))?;

    let mut network = Network::new(&master);
    let (nmt, mut sdo) = (network.nmt(), network.sdo(id)?);
    let (event, events) = luna::buffered::<NodeEvent>(Buffer::fifo(16));
    let heartbeats = network.heartbeats(event);
    let limit = Duration::from_millis(200);
    main.process("heartbeats")
        .spawn(heartbeats.watch(id, limit, OnMissed::Emergency))?;
    let (value, values) = luna::buffered::<(u16, i32)>(Buffer::overwrite_oldest(1));
    network.tpdo(from_drive, value)?;
    let (target, targets) = luna::buffered::<(u16, i32)>(Buffer::overwrite_oldest(1));
    main.process("targets")
        .spawn(network.rpdo(to_drive, targets)?)?;
    let (switch, switches) = luna::buffered::<bool>(Buffer::fifo(1));
    main.process("sync").spawn(network.sync(PERIOD, switches))?;
    main.process("can").spawn(network.controller())?;
    drop((master, simulated));

    let (report, reached) = mpsc::channel();
    main.process("control").spawn(async move {
        while events.recv().await? != NodeEvent::BootUp(id) {}
        PdoSetting::new(Direction::Tpdo, 1, from_drive, Transmission::Synchronous(1))?
            .map::<u16>(STATUS)?
            .map::<i32>(POSITION)?
            .write(&mut sdo)
            .await?;
        PdoSetting::new(Direction::Rpdo, 1, to_drive, Transmission::OnEvent)?
            .map::<u16>(CONTROL)?
            .map::<i32>(TARGET)?
            .write(&mut sdo)
            .await?;
        nmt.command(NmtCommand::Start, Some(id)).await?;
        let mut set_point = 0;
        loop {
            let (_, position) = values.recv().await?;
            if position == GOAL {
                break;
            }
            set_point = GOAL.min(set_point + 200);
            target.send((0xF, set_point)).await?;
        }
        println!("{:?} the goal is reached", luna::now());
        let _ = report.send(luna::now());
        breaks.cut("drive");
        println!("{:?} the cable breaks", luna::now());
        std::future::pending::<()>().await;
        drop((switch, events));
        Ok(())
    })?;
    let end = system
        .run()
        .err()
        .map_or("well".to_owned(), |error| error.to_string());
    println!("the system ends: {end}");

    let is_emergency = system
        .report()
        .is_some_and(|report| report.end == End::Emergency);
    match reached.try_recv().is_ok() && is_emergency && end.contains("no heartbeat") {
        true => println!("ok: the drive reached its goal, and its loss was an emergency"),
        false => return Err(luna::Error::other("the drive is not as expected")),
    }
    Ok(())
}

/// What the drive moves: it follows its target.
async fn move_motor(motor: NodeControl) -> luna::Result<()> {
    let mut tick = luna::periodic("motor", Duration::from_millis(1))?;
    loop {
        tick.next().await;
        if let (Some(0xF), Some(target)) = (motor.get::<u16>(CONTROL), motor.get::<i32>(TARGET)) {
            let position = motor.get::<i32>(POSITION).unwrap_or_default();
            let step = (target - position).clamp(-50, 50);
            motor.set(POSITION, position + step).await?;
        }
    }
}
