//! A partner that writes anything into the shared memory, at any time: what comes of it are errors,
//! wrong values and waits that end with the local channel; never a panic, nor an access outside.

use crate::channel_name;
use crate::shared::{Random, is_long};
use luna::prelude::*;
use luna_ipc::any::AnyType;
use luna_ipc::{Blackboard, Endpoint, look};
use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, mpsc};
use std::time::Duration;

/// How many there are in one session; then all is opened anew.
const EACH: u64 = 40;

/// What all sessions have seen.
#[derive(Default)]
struct Seen {
    values: AtomicU64,
    errors: AtomicU64,
}

/// Set when the session is over.
type Stop = Arc<AtomicBool>;

fn corruptions() -> u64 {
    let stated = std::env::var("LUNA_CORRUPTIONS").ok();
    let stated = stated.map(|text| text.parse().expect("LUNA_CORRUPTIONS is a number"));
    stated.unwrap_or(if is_long() { 10_000 } else { 1_000 })
}

/// The words of a channel, to be written over.
struct Words(File, u64);

impl Words {
    fn of(name: &str) -> Self {
        let path = format!("/dev/shm/luna-ipc.{}.words", name.replace('/', "+"));
        let file = OpenOptions::new().write(true).open(path).unwrap();
        let size = file.metadata().unwrap().len();
        Self(file, size)
    }

    /// Up to 16 bytes, mostly among the words of the protocol, mostly such as change a sum most.
    fn corrupt(&self, random: &mut Random) {
        let end = match random.below(4_u8) {
            0 => self.1,
            1 => self.1.min(8192),
            _ => 1024,
        };
        let at = random.below(end) & !if random.chance(200) { 7 } else { 0 };
        let number = match random.below(6_u8) {
            0 => 0,
            1 => u64::MAX,
            2 => i64::MAX as u64,
            3 => 1,
            4 => random.below(64),
            _ => random.next(),
        };
        let bytes = number.to_ne_bytes();
        let length = [1, 4, 8, 8][random.below(4_usize)];
        let length = length.min(usize::try_from(self.1 - at).unwrap());
        self.0.write_all_at(&bytes[..length], at).unwrap();
    }
}

/// Runs a link until it ends, as it may with an error of its own kind.
async fn carried<L: luna::Process>(mut link: L, seen: Arc<Seen>) -> luna::Result<()> {
    link.pre_run()?;
    if link.run().await.is_err() {
        seen.errors.fetch_add(1, Relaxed);
    }
    Ok(())
}

/// What poisons the local channels at the end of a session.
type Ends = Vec<Box<dyn Fn() + Send>>;

/// Opens each kind of channel in this program, both sides, as two programs would, and lets values
/// go through until the end. Says through `begun` that the first one has.
fn session(
    names: &[String],
    stop: &Stop,
    seen: &Arc<Seen>,
    begun: mpsc::Sender<()>,
) -> luna::Result<System> {
    let [plain, texts, called, lent, shared] = names else {
        unreachable!("there are five");
    };
    let mut system = System::new("corrupted");
    let main = system.executor("main").build()?;
    let mut ends: Ends = Vec::new();

    let (sender, link) = luna_ipc::sender::<[u64; 32]>(plain)?;
    main.process("plain sends")
        .spawn(carried(link, seen.clone()))?;
    let (receiver, link) = luna_ipc::receiver::<[u64; 32]>(plain)?;
    main.process("plain receives")
        .spawn(carried(link, seen.clone()))?;
    let end = (sender.clone(), receiver.clone());
    ends.push(Box::new(move || (end.0.poison(), end.1.poison()).0));
    main.process("gives").spawn(async move {
        while sender.send([1; 32]).await.is_ok() {}
        Ok(())
    })?;
    let counts = seen.clone();
    main.process("takes").spawn(async move {
        while receiver.recv().await.is_ok() {
            counts.values.fetch_add(1, Relaxed);
            let _ = begun.send(()); // the test waits for the first only
        }
        Ok(())
    })?;

    #[cfg(feature = "serde")]
    {
        let endpoint = Endpoint::new(texts);
        let (sender, link) = endpoint.serde_sender::<Vec<String>>(200)?;
        main.process("serde sends")
            .spawn(carried(link, seen.clone()))?;
        let (receiver, link) = endpoint.serde_receiver::<Vec<String>>(200)?;
        main.process("serde receives")
            .spawn(carried(link, seen.clone()))?;
        let end = (sender.clone(), receiver.clone());
        ends.push(Box::new(move || (end.0.poison(), end.1.poison()).0));
        main.process("writes").spawn(async move {
            let text = || vec!["ü".repeat(40), "b".to_owned()];
            while sender.send(text()).await.is_ok() {}
            Ok(())
        })?;
        main.process("reads").spawn(async move {
            while let Ok(text) = receiver.recv().await {
                let is_one = |text: &String| std::str::from_utf8(text.as_bytes()).is_ok();
                assert!(text.iter().all(is_one));
            }
            Ok(())
        })?;
    }

    let (client, link) = luna_ipc::client::<u64, [u64; 8]>(called)?;
    main.process("calls").spawn(carried(link, seen.clone()))?;
    let (server, link) = luna_ipc::server::<u64, [u64; 8]>(called)?;
    main.process("is called")
        .spawn(carried(link, seen.clone()))?;
    let end = (client.clone(), server.clone());
    ends.push(Box::new(move || (end.0.poison(), end.1.poison()).0));
    main.process("asks").spawn(async move {
        while client.call(1).await.is_ok() {}
        Ok(())
    })?;
    main.process("answers").spawn(async move {
        while let Ok(call) = server.accept().await {
            let _ = call.reply([2; 8]); // the client may have gone
        }
        Ok(())
    })?;

    let endpoint = Endpoint::new(lent);
    let (loans, sender, link) = endpoint.loan_sender(3, &[3_u64; 512])?;
    main.process("lends").spawn(carried(link, seen.clone()))?;
    let (receiver, link) = endpoint.loan_receiver::<[u64; 512]>(3)?;
    main.process("borrows").spawn(carried(link, seen.clone()))?;
    let end = (sender.clone(), receiver.clone());
    ends.push(Box::new(move || (end.0.poison(), end.1.poison()).0));
    main.process("fills").spawn(async move {
        // A slot that is marked as taken stays so.
        while let Some(loan) = loans.loan() {
            if sender.send(loan).await.is_err() {
                break;
            }
        }
        Ok(())
    })?;
    main.process("uses").spawn(async move {
        while let Ok(lent) = receiver.recv().await {
            std::hint::black_box(lent.iter().fold(0, |sum: u64, n| sum.wrapping_add(*n)));
        }
        Ok(())
    })?;

    let board = Blackboard::new(shared).entry("speeds", [0_u64; 16]);
    let mut writer = board.entry("text", [0_u8; 3]).write()?;
    let mut speeds = writer.take::<[u64; 16]>("speeds")?;
    let reader = Blackboard::new(shared).read()?;
    let entry = reader.entry::<[u64; 16]>("speeds")?;
    let is_over = stop.clone();
    main.process("board").spawn(async move {
        let _open = (writer, reader);
        while !is_over.load(Relaxed) {
            speeds.set([4; 16]);
            std::hint::black_box(entry.get().map(|reading| reading.age()).ok());
            luna::after(Duration::from_micros(200)).await;
        }
        ends.iter().for_each(|end| end());
        Ok(())
    })?;
    Ok(system)
}

/// What another program does meanwhile that looks at all, and tries to come in.
fn visit(names: &[String]) {
    for name in names {
        let found = look::at(name).ok().flatten();
        for key in found.iter().flat_map(|found| &found.keys) {
            let value =
                AnyType::raw(&key.value).map(|of| of.read(&key.bytes).map(|v| v.to_string()));
            std::hint::black_box(value.is_ok());
        }
        let Some(found) = found else { continue };
        if let Ok(of) = AnyType::raw(&found.value) {
            drop(Endpoint::new(name).any_receiver(&of));
            drop(Endpoint::new(name).any_sender(&of));
        }
        let board = Blackboard::new(name).read();
        if let Ok(entry) = board.and_then(|board| board.entry::<[u64; 16]>("speeds")) {
            std::hint::black_box(entry.get().is_ok());
        }
    }
}

/// The sizes that a partner states, next to the largest numbers: `luna echo --raw` opens by them.
#[test]
fn sizes_that_a_partner_states_are_checked() {
    const SIZE: u64 = 8;
    const NAME_LENGTH: u64 = 28;
    const NAME: u64 = 32;
    let name = channel_name("stated");
    let (_sender, _link) = luna_ipc::sender::<u64>(&name).unwrap();
    let words = Words::of(&name);
    for stated in ["u64", "x by postcard"] {
        let length = stated.len() as u32;
        words.0.write_all_at(stated.as_bytes(), NAME).unwrap();
        words
            .0
            .write_all_at(&length.to_ne_bytes(), NAME_LENGTH)
            .unwrap();
        for below in 0..9 {
            let size = u64::MAX - below;
            words.0.write_all_at(&size.to_ne_bytes(), SIZE).unwrap();
            let found = look::at(&name).unwrap().unwrap();
            assert_eq!((&*found.value.name, found.value.size), (stated, size));
            let of = AnyType::raw(&found.value).unwrap();
            let error = Endpoint::new(&name).any_receiver(&of).unwrap_err();
            assert!(matches!(error, luna_ipc::IpcError::Size { .. }), "{error}");
        }
    }
}

/// The same of the keys of a blackboard, and the numbers of their values.
#[test]
fn sizes_in_a_blackboard_are_checked() {
    // Of the first entry, in the second page: its size, alignment and place.
    const FIELDS: [u64; 3] = [4096 + 64 + 312, 4096 + 64 + 320, 4096 + 64 + 328];
    let name = channel_name("keys");
    let board = Blackboard::new(&name)
        .entry("one", 1_u64)
        .entry("two", 2_u64);
    let _writer = board.write().unwrap();
    let words = Words::of(&name);
    let put = |number: u64, at| words.0.write_all_at(&number.to_ne_bytes(), at).unwrap();
    for (field, was) in FIELDS.into_iter().zip([8_u64, 8, 8192]) {
        for number in [u64::MAX, u64::MAX - 63, i64::MAX as u64, 1 << 62] {
            put(number, field);
            let found = look::at(&name).unwrap().unwrap();
            assert_eq!(found.keys.len(), 1, "field {field}: {number}");
            let error = Blackboard::new(&name).read().unwrap().entry::<u64>("one");
            assert!(error.is_err());
        }
        put(was, field);
    }
    // The newest value's number is in the first word of a cell: their sum is shown.
    put(u64::MAX, 8192);
    let found = look::at(&name).unwrap().unwrap();
    assert_eq!(found.sent, u64::MAX);
}

#[test]
fn memory_that_a_partner_writes_over_at_random() {
    own_process!(long);
    let (mut random, total) = (Random::seeded(), corruptions());
    let seen = Arc::new(Seen::default());
    for number in 0..total.div_ceil(EACH) {
        // A session that does not come to its end is a failure, and says where it was.
        let _watchdog = crate::shared::watchdog();
        let kinds = ["plain", "serde", "calls", "lent", "board"];
        let names = kinds.map(|kind| channel_name(&format!("corrupted/{number}/{kind}")));
        let stop = Stop::default();
        let (begun, has_begun) = mpsc::channel();
        let system = session(&names, &stop, &seen, begun).unwrap();
        let running = std::thread::spawn(move || system.run().map(drop));
        // On a loaded machine all would be written over before the first value is sent.
        has_begun.recv().unwrap();
        let there = |name: &&String| cfg!(feature = "serde") || !name.ends_with("serde");
        let words: Vec<Words> = names
            .iter()
            .filter(there)
            .map(|name| Words::of(name))
            .collect();
        for _ in 0..EACH {
            words[random.below(words.len())].corrupt(&mut random);
            match random.below(16_u8) {
                0 => visit(&names),
                1..8 => std::thread::sleep(Duration::from_micros(random.below(800))),
                _ => {}
            }
        }
        stop.store(true, Relaxed);
        running.join().unwrap().unwrap();
        for name in &names {
            assert_eq!(crate::files(name), [""; 0], "{number}");
        }
    }
    let (values, errors) = (seen.values.load(Relaxed), seen.errors.load(Relaxed));
    println!("{total} corruptions: {values} values, {errors} links with an error");
    assert!(values > 0 && errors > 0);
}
