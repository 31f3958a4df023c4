use super::*;
use crate::format::Record;
use std::sync::mpsc::channel;

#[test]
fn a_slow_resolver_delays_nothing() {
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    let there = receiver.local_addr().unwrap();
    let (answer, gate) = channel();
    let mut sink = UdpSink::new("recorder.invalid:7411");
    let search = Search::by(move || gate.recv().map_err(io::Error::other));
    sink.search = Some(search.unwrap());
    sink.begin(&Encoder::head()).unwrap();
    let mut encoder = Encoder::new();
    encoder.put(&Record::Epoch { time: 1, unix: 1 });
    let block = encoder.block().to_vec();
    // Without an answer it returns an error instead of waiting.
    assert!(sink.block(&block).is_err());
    assert!(sink.socket.is_none() && sink.search.is_some());
    answer.send(there).unwrap();
    while sink.search.is_some() {
        let _ = sink.block(&block);
        std::thread::yield_now();
    }
    let mut buffer = [0; 4096];
    let got = receiver.recv(&mut buffer).unwrap();
    assert!(buffer[..got].ends_with(&block[crate::format::BLOCK_START..]));
}
