//! A process with three phases, and two ways in which a network ends.
// ANCHOR: process
use luna::prelude::*;

struct Recorder {
    input: Receiver<f64>,
    samples: Vec<f64>,
}

impl Process for Recorder {
    /// Before any body runs. It may allocate and block.
    fn pre_run(&mut self) -> luna::Result<()> {
        self.samples.reserve_exact(1000);
        Ok(())
    }

    /// The body: the real-time part.
    async fn run(&mut self) -> luna::Result<()> {
        while let Ok(sample) = self.input.recv().await {
            self.samples.push(sample);
        }
        Ok(())
    }

    /// When the body has ended, for whatever reason, off the real-time path.
    fn post_run(&mut self) {
        println!("{} samples", self.samples.len());
    }
}
// ANCHOR_END: process

// ANCHOR: system
fn main() -> luna::Result<()> {
    let mut system = System::new("recorder");
    let main = system.executor("main").build()?;
    let (output, input) = luna::channel();
    main.process("recorder").spawn(Recorder {
        input,
        samples: Vec::new(),
    })?;
    main.process("source").spawn(async move {
        for sample in [0.1, 0.2, 0.3] {
            output.send(sample).await?;
        }
        Ok(()) // `output` is dropped here, so the recorder ends too
    })?;
    system.run()?;
    Ok(())
}
// ANCHOR_END: system
