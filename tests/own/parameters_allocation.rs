//! Reading parameters and taking a set allocates and frees nothing, in a loop and by hand, while
//! others set.

use crate::ALLOCATOR;
use crate::common;

use common::watchdog;
use luna::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

#[derive(Default)]
struct Reads {
    name: &'static str,
    number: Option<Parameter<f64>>,
    list: Option<Parameter<[f32; 4]>>,
    over: Arc<AtomicBool>,
}

impl Process for Reads {
    fn pre_run(&mut self) -> luna::Result<()> {
        let name = |part: &str| format!("{}/{part}", self.name);
        self.number = Some(Parameter::with_default(&name("number"), 0.0).register()?);
        self.list = Some(Parameter::with_default(&name("list"), [0.0; 4]).register()?);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        let (Some(number), Some(list)) = (&self.number, &self.list) else {
            return Ok(());
        };
        let counted = ALLOCATOR.here();
        let mut tick = luna::periodic(self.name, Duration::from_micros(500))?;
        let mut taken = 0;
        let mut before = 0.0;
        // Until it has taken twenty sets.
        while taken < 20 {
            tick.next().await;
            number.latch();
            let now = number.get();
            assert_eq!(list.get(), [now as f32; 4]);
            assert_eq!(list.clone().get(), [now as f32; 4]);
            taken += u32::from(now != before);
            before = now;
        }
        drop(tick);
        assert_eq!(ALLOCATOR.here(), counted);
        self.over.store(true, Ordering::Relaxed);
        Ok(())
    }
}

#[test]
fn nothing_is_allocated_or_freed_where_parameters_are_read() {
    own_process!();
    let _watch = watchdog();
    let mut system = System::new("reads");
    let mut overs = Vec::new();
    for name in ["left", "right"] {
        let over = Arc::new(AtomicBool::new(false));
        overs.push(over.clone());
        let executor = system.executor(name).build().unwrap();
        let reads = Reads {
            name,
            over,
            ..Reads::default()
        };
        executor.process(name).spawn(reads).unwrap();
    }
    let parameters = system.parameters();
    system
        .thread("console")
        .process("operator")
        .spawn(async move {
            let mut value = 0.0;
            while !overs.iter().all(|over| over.load(Ordering::Relaxed)) {
                value = f64::from(value as u16 % 1000 + 1);
                for name in ["left", "right"] {
                    let number = (format!("{name}/number"), value.into());
                    let list = [value as f32; 4];
                    parameters.set([number, (format!("{name}/list"), list.into())]
                        as [(String, luna::parameters::Value); 2])?;
                }
                luna::after(Duration::from_micros(200)).await;
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
}
