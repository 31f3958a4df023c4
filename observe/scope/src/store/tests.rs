use super::*;
use luna_logger::Level;
use luna_logger::format::{ClockBase, Encoder, Reader, SignalInfo};

const MAX: usize = 1 << 20;

fn begun() -> Store {
    let mut store = Store::new(MAX);
    let recording = store.begin();
    store.take(
        recording,
        &Record::Session {
            system: "machine",
            clock: ClockBase::Virtual,
            written_by: "a test",
        },
    );
    store.take(
        recording,
        &Record::Signal(SignalInfo {
            number: 3,
            element_type: Type::F64,
            elements: 1,
            name: "arm/angle",
            unit: "rad",
            description: "",
        }),
    );
    store
}

fn sample(store: &mut Store, time: u64, value: f64) {
    let bytes = value.to_le_bytes();
    let values = Values::from_bytes(Type::F64, &bytes);
    let signal = 3;
    let record = Record::Sample {
        signal,
        time,
        values,
    };
    store.take(store.recording, &record);
}

/// The samples in some blocks, which must be readable by themselves.
fn samples(blocks: &[Arc<[u8]>]) -> Vec<u64> {
    let mut times = Vec::new();
    read(blocks, &mut |record| {
        if let Record::Sample { time, .. } = record {
            times.push(*time);
        }
    });
    times
}

fn read(blocks: &[Arc<[u8]>], take: &mut dyn FnMut(&Record<'_>)) {
    let mut file = Encoder::head().to_vec();
    let mut encoder = Encoder::new();
    for (number, block) in (0u32..).zip(blocks) {
        // Blocks are numbered again: a viewer ignores the numbers.
        encoder.discard();
        let mut block = block.to_vec();
        block[4..8].copy_from_slice(&number.to_le_bytes());
        let checksum = zlib(&block[4..12], &block[16..]);
        block[12..16].copy_from_slice(&checksum.to_le_bytes());
        file.extend(block);
    }
    let mut reader = Reader::new(&file[..]).unwrap();
    while let Some(record) = reader.next().unwrap() {
        take(&record);
    }
}

fn zlib(head: &[u8], rest: &[u8]) -> u32 {
    let mut state = !0u32;
    for byte in head.iter().chain(rest) {
        state ^= u32::from(*byte);
        for _ in 0..8 {
            state = state >> 1 ^ (0xEDB8_8320 & 0u32.wrapping_sub(state & 1));
        }
    }
    !state
}

#[test]
fn a_late_viewer_gets_the_start_and_from_when_on_there_is_anything() {
    let mut store = begun();
    let news = store.news(&mut Position::default(), 0);
    assert_eq!((news.start, news.kept_from), (None, [None; 2]));
    for n in 0..1_000_000u64 {
        sample(&mut store, 5 + n * 1_000_000, n as f64);
    }
    let mut position = Position::default();
    let news = store.news(&mut position, MAX);
    assert_eq!(news.start, Some(5));
    let first = samples(&news.blocks)[0];
    assert!(first > 5);
    assert_eq!(news.kept_from, [Some(first), None]);
}

#[test]
fn memory_is_bounded_whatever_comes() {
    let mut store = begun();
    for n in 0..1_000_000u64 {
        sample(&mut store, n * 1_000_000, n as f64);
    }
    assert!(store.held() <= MAX, "{}", store.held());
    assert_eq!(store.held(), store.samples.bytes);
    let mut position = Position::default();
    let news = store.news(&mut position, usize::MAX);
    assert!(news.begins && news.missed == 0);
    let times = samples(&news.blocks);
    assert!(times.is_sorted());
    assert!(times.len() > 25_000 && *times.last().unwrap() > 990_000_000_000);
}

#[test]
fn events_displace_no_samples() {
    let mut store = begun();
    sample(&mut store, 5, 0.5);
    for time in 0..2_000_000u64 {
        let event = Event {
            thread: 0,
            time: 6 + time * 1000,
            code: 2,
            subject: 1,
            arguments: [0; 2],
        };
        store.take(store.recording, &Record::Event(event));
    }
    assert!(store.events.first > 0 && store.held() <= MAX);
    sample(&mut store, 3_000_000_000, 0.5);
    let mut position = Position::default();
    let news = store.news(&mut position, 1);
    assert_eq!(samples(&news.blocks), [5, 3_000_000_000]);
    assert!(news.kept_from[0].is_none() && news.kept_from[1] > Some(6));
    // Each kind goes on, whatever there is of the other.
    let before = position.next;
    store.news(&mut position, 1);
    assert_eq!(position.next[1], before[1] + 1);
}

#[test]
fn an_overview_of_all_samples_stays() {
    let mut store = begun();
    sample(&mut store, 7, 0.5);
    for n in 1..1_000_000u64 {
        let value = if n == 3 { -9.0 } else { (n / 500_000) as f64 };
        sample(&mut store, 7 + n * 1_000_000, value);
    }
    sample(&mut store, 7 + 1_000_000_000_000, f64::NAN);
    let news = store.news(&mut Position::default(), 1);
    assert_eq!(news.overviews.len(), 1);
    let overview = &news.overviews[0];
    assert_eq!(
        (&overview["signal"], &overview["span"]),
        (&json!(3), &json!(2_560_000_000u64))
    );
    let spans = overview["elements"][0].as_array().unwrap();
    assert_eq!(spans.len(), 391);
    assert_eq!(
        (&spans[0], &spans[1]),
        (&json!([-9.0, 0.5]), &json!([0.0, 0.0]))
    );
    assert_eq!(
        (&spans[195], &spans[390]),
        (&json!([0.0, 1.0]), &json!([1.0, 1.0]))
    );
}

#[test]
fn a_late_viewer_gets_the_declarations() {
    let mut store = begun();
    for n in 0..200_000u64 {
        sample(&mut store, n * 1_000_000, 0.5);
    }
    // The block with the signal's declaration is not in memory any more: the reader would refuse
    // its samples.
    assert!(store.samples.first > 0);
    let news = store.news(&mut Position::default(), usize::MAX);
    assert!(!samples(&news.blocks).is_empty());
}

fn message(store: &mut Store, time: u64, level: Level, text: &str) {
    store.take(
        store.recording,
        &Record::Message {
            thread: 1,
            time,
            level,
            process: 2,
            truncated: false,
            target: "machine",
            text,
        },
    );
}

/// The texts of all messages, in the order in which a viewer gets them.
fn texts(blocks: &[Arc<[u8]>]) -> Vec<String> {
    let mut texts = Vec::new();
    read(blocks, &mut |record| {
        if let Record::Message { text, .. } = record {
            texts.push((*text).to_owned());
        }
    });
    texts
}

#[test]
fn warnings_and_errors_stay_when_their_blocks_are_gone() {
    let mut store = begun();
    let mut position = Position::default();
    store.news(&mut position, usize::MAX);
    message(&mut store, 1, Level::Warn, "hot");
    message(&mut store, 2, Level::Info, "on the way");
    message(&mut store, 3, Level::Error, "stopped");
    for n in 0..300_000u64 {
        sample(&mut store, n * 1_000_000, 0.5);
    }
    let last = 400_000_000_000;
    message(&mut store, last, Level::Warn, "hot again");
    store.cut();
    let all = ["hot", "stopped", "hot again"];
    let late = store.news(&mut Position::default(), usize::MAX);
    assert_eq!(texts(&late.blocks), all);
    // One that was too slow gets them as well, and nobody gets one twice.
    assert_eq!(texts(&store.news(&mut position, usize::MAX).blocks), all);
    for n in 0..300_000u64 {
        sample(&mut store, last + n * 1_000_000, 0.5);
    }
    let news = store.news(&mut position, usize::MAX);
    assert!(news.missed > 0 && texts(&news.blocks).is_empty());

    // The last of those before the place that is sought in a file, no longer than a declaration.
    store.begin_at(1_000);
    for n in 0..200 {
        message(&mut store, n, Level::Error, &"x".repeat(300));
    }
    message(&mut store, 1_000, Level::Info, "there");
    store.cut();
    let news = store.news(&mut Position::default(), usize::MAX);
    let texts = texts(&news.blocks);
    assert_eq!(texts.len(), 49);
    assert!(texts[..48].iter().all(|text| text.len() == 256));
}

#[test]
fn a_slow_viewer_gets_the_number_of_missed_blocks() {
    let mut store = begun();
    let mut position = Position::default();
    store.news(&mut position, usize::MAX);
    for n in 0..300_000u64 {
        sample(&mut store, n * 1_000_000, 0.5);
    }
    let news = store.news(&mut position, usize::MAX);
    assert!(news.missed > 0 && !news.begins);
    assert!(!samples(&news.blocks).is_empty());
    assert_eq!(store.news(&mut position, usize::MAX).missed, 0);
}

#[test]
fn what_was_declared_is_within_what_a_viewer_gets_at_once() {
    let mut store = begun();
    let name = "x".repeat(200);
    for number in 0..10_000 {
        let name = name.as_str();
        store.take(store.recording, &Record::Thread { number, name });
    }
    for n in 0..300_000u64 {
        sample(&mut store, n * 1_000_000, 0.5);
    }
    assert_eq!(store.status()["left_out_declarations"], true);
    let mut position = Position::default();
    let mut all = 0;
    loop {
        let News { blocks, begins, .. } = store.news(&mut position, MAX);
        let bytes: Vec<usize> = blocks.iter().map(|block| block.len()).collect();
        assert_eq!(begins, all == 0);
        assert!(bytes.iter().sum::<usize>() - bytes.last().unwrap_or(&0) <= MAX);
        all += bytes.len();
        if bytes.is_empty() {
            break;
        }
    }
    assert!(all > store.samples.since(0).count());
    // Even if there is room for nothing else, there is for a block.
    let news = store.news(&mut Position::default(), 1);
    assert_eq!(news.blocks.len(), news.declarations + 1);
}

#[test]
fn a_new_recording_restarts_all_viewers() {
    let mut store = begun();
    let mut position = Position::default();
    assert!(store.news(&mut position, usize::MAX).begins);
    assert!(!store.news(&mut position, usize::MAX).begins);
    store.begin();
    assert!(store.news(&mut position, usize::MAX).begins);
}

#[test]
fn a_million_samples_a_second_are_reduced() {
    let mut store = begun();
    for n in 0..2_000_000u64 {
        sample(&mut store, n * 1000, (n % 977) as f64);
    }
    let left_out = store.status()["left_out_samples"].as_u64().unwrap();
    assert!(left_out > 1_960_000, "{left_out}");
}

#[test]
fn of_too_many_events_the_ones_that_matter_go_on() {
    let mut store = begun();
    let event = |code| Event {
        thread: 0,
        time: 5,
        code,
        subject: 1,
        arguments: [0; 2],
    };
    for _ in 0..crate::reduce::MAX_EVENTS + 10 {
        store.take(store.recording, &Record::Event(event(2)));
    }
    store.take(store.recording, &Record::Event(event(12)));
    let position = &mut Position::default();
    let blocks = store.news(position, usize::MAX).blocks;
    assert_eq!(store.left_out_events, 10);
    assert!(!blocks.is_empty());
}
