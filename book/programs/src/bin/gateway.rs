//! A control loop and tasks of tokio in one program, with a gateway between them.
// ANCHOR: loop
use luna::prelude::*;
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};

/// LUNA's side: a loop that never waits for a task.
async fn control(set_points: Receiver<f64>, places: Sender<f64>) -> luna::Result<()> {
    let mut tick = luna::periodic("control", Duration::from_millis(1))?;
    let (mut target, mut place) = (0.0, 0.0);
    loop {
        tick.next().await;
        match set_points.try_recv() {
            Ok(new) => target = new,
            Err(luna::TryRecvError::Empty) => {} // no new one
            Err(_) => return Ok(()),             // the gateway has dropped its end
        }
        place += (target - place) * 0.1; // on a machine: read the sensor, drive the motor
        places.send(place).await?; // the buffer overwrites, so this does not wait
    }
}

fn run(set_points: Receiver<f64>, places: Sender<f64>) -> luna::Result<luna::Report> {
    let mut system = System::new("axis");
    let fast = system.executor("fast").policy(Policy::fifo(80)).build()?;
    fast.process("control").spawn(control(set_points, places))?;
    system.run()
}
// ANCHOR_END: loop

// ANCHOR: gateway
struct Move {
    to: f64,
    done: oneshot::Sender<f64>,
}

/// tokio's side: a task that answers each request when the axis has arrived.
async fn gateway(
    mut requests: mpsc::Receiver<Move>,
    set_point: Sender<f64>,
    places: Receiver<f64>,
) -> luna::Result<()> {
    loop {
        let request = tokio::select! {
            request = requests.recv() => request,
            _ = set_point.closed() => None, // the system has ended
        };
        let Some(Move { to, done }) = request else {
            return Ok(());
        };
        set_point.send(to).await?;
        let mut place = places.recv().await?;
        while (place - to).abs() > 1e-3 {
            place = places.recv().await?;
        }
        let _ = done.send(place); // an error: the client does not wait any more
    }
}
// ANCHOR_END: gateway

// ANCHOR: main
fn newest(name: &str) -> (Sender<f64>, Receiver<f64>) {
    let (sender, receiver) = luna::buffered(Buffer::overwrite_oldest(1));
    (sender.named(name), receiver)
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> luna::Result<()> {
    let (set_point, set_points) = newest("set-point");
    let (measured, places) = newest("place");
    // `System::run` blocks its thread until the system has ended: it gets one of its own.
    let system = tokio::task::spawn_blocking(move || run(set_points, measured));

    let (requests, input) = mpsc::channel(8);
    let client = async move {
        for to in [1.0, 2.0] {
            let (done, answer) = oneshot::channel();
            if requests.send(Move { to, done }).await.is_err() {
                return;
            }
            if let Ok(place) = answer.await {
                println!("the axis is at {place:.1}");
            }
        }
    };
    let (ended, ()) = tokio::join!(gateway(input, set_point, places), client);
    // First the system's error: it is why the gateway has ended, if both have failed.
    let report = system.await.map_err(luna::Error::other)??;
    println!("ended: {}", report.end);
    match ended {
        Err(error) if error.is_closed() => Ok(()), // during a move: by a signal, for instance
        ended => ended,
    }
}
// ANCHOR_END: main
