//! What is recorded and what is lost is all there was.

use super::*;

/// A sink that refuses each other block.
struct Moody(Memory, bool);

impl Sink for Moody {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.0.begin(head)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.1 = !self.1;
        if self.1 {
            return Err(io::Error::other("not now"));
        }
        self.0.block(block)
    }
}

#[test]
fn what_is_recorded_and_what_is_lost_is_all_there_was() -> luna::Result<()> {
    let rounds = 3000;
    // On virtual time there are as many each time.
    let run = |recording: Logging| -> luna::Result<_> {
        let mut system = System::new("commstime");
        system.virtual_clock().log(recording);
        commstime(&mut system, rounds)?;
        Ok(system.run()?.logging.unwrap().events)
    };
    let memory = Memory::default();
    let all = run(Logging::to_sink(memory.clone()).room_for_events(1 << 20))?;
    assert_eq!(all.lost, 0);
    assert!(all.recorded >= 16 * rounds, "{all:?}");

    let memory = Memory::default();
    let few = run(Logging::to_sink(memory.clone()).room_for_events(64))?;
    assert_eq!(few.recorded + few.lost, all.recorded);
    let decoded = Decoded::read(&memory);
    assert_eq!(
        (decoded.events.len() as u64, decoded.lost),
        (few.recorded, few.lost)
    );

    let memory = Memory::default();
    let sink = Moody(memory.clone(), false);
    let moody = run(Logging::to_sink(sink).room_for_events(1 << 20))?;
    assert_eq!(moody.recorded + moody.lost, all.recorded);
    // What was not refused can be read, with its names.
    let decoded = Decoded::read(&memory);
    assert_eq!(decoded.events.len() as u64, moody.recorded);
    let is_named = |(channel, _, _): &(&str, &str, &str)| !channel.is_empty();
    assert!(decoded.communications().iter().all(is_named));
    Ok(())
}
