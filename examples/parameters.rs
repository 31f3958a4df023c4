//! A control loop with gains as parameters: they come from a TOML file and the command line, and
//! are replaced while it runs.
//!
//! `cargo run --example parameters -- --set cart/kp=30` starts with another gain;
//! `--parameters FILE` with a file of your own.
use luna::parameters::{Choice, SetError};
use luna::prelude::*;
use luna::system::ProcessBuilder;
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);

/// Which way the cart is to go.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Goal {
    Left,
    Right,
}

impl Choice for Goal {
    const CHOICES: &'static [(&'static str, Goal)] =
        &[("left", Goal::Left), ("right", Goal::Right)];
}

/// The parameters of a cart's controller.
struct Settings {
    kp: Parameter<f64>,
    kd: Parameter<f64>,
    goal: Parameter<Goal>,
}

impl Settings {
    /// Declares them for the process that is to be the controller.
    fn declare(cart: &ProcessBuilder) -> luna::Result<Self> {
        Ok(Self {
            kp: cart
                .parameter("cart/kp", 20.0)
                .unit("N/m")
                .range(0.0..=100.0)
                .description("force by distance")
                .register()?,
            kd: cart
                .parameter("cart/kd", 5.0)
                .unit("N·s/m")
                .range(0.0..=50.0)
                .description("force by speed")
                .register()?,
            goal: cart.parameter("cart/goal", Goal::Left).register()?,
        })
    }
}

/// A cart with its controller: a mass of 1 kg that is pushed.
async fn control(Settings { kp, kd, goal }: Settings) -> luna::Result<()> {
    let (mut place, mut speed) = (0.0_f64, 0.0_f64);
    let mut tick = luna::periodic("cart", PERIOD)?;
    for _ in 0..6000 {
        // From here to the next tick all parameters are of one set.
        let cycle = tick.next().await;
        let target = match goal.get() {
            Goal::Left => -1.0,
            Goal::Right => 1.0,
        };
        let force = kp.get() * (target - place) - kd.get() * speed;
        speed += force * PERIOD.as_secs_f64();
        place += speed * PERIOD.as_secs_f64();
        if cycle.number % 1000 == 0 {
            println!(
                "after {} s: {place:6.3} m, with kp {} N/m",
                cycle.number / 1000,
                kp.get()
            );
        }
    }
    assert!((place - 1.0).abs() < 0.01, "the cart is at {place} m");
    Ok(())
}

fn main() -> luna::Result<()> {
    let file = std::env::temp_dir().join(format!("cart-{}.toml", std::process::id()));
    std::fs::write(&file, "[cart]\nkp = 25.0\nkd = 10 # almost no overshoot\n")?;

    let mut system = System::new("cart");
    // Each run the same, in no time; without this line it takes six seconds.
    system.virtual_clock();
    system.parameters_from(&file);
    system.parameter_arguments(std::env::args().skip(1))?;
    let main = system.executor("main").build()?;
    let cart = main.process("cart");
    let settings = Settings::declare(&cart)?;
    cart.spawn(control(settings))?;

    let parameters = system.parameters();
    system
        .thread("console")
        .process("operator")
        .spawn(async move {
            for parameter in parameters.list() {
                println!("{parameter}");
            }
            luna::after(Duration::from_millis(2500)).await;
            // One set: the cart turns round with the gains that belong to it.
            parameters.set_text("cart/goal=right, cart/kp=50, cart/kd=14")?;
            luna::after(Duration::from_millis(1000)).await;
            // Nothing of this one.
            match parameters.set([("cart/kp", 500.0), ("cart/dk", 1.0)]) {
                Err(SetError::Refused(refused)) => {
                    refused.iter().for_each(|one| println!("refused: {one}"))
                }
                other => println!("{other:?}"),
            }
            Ok(())
        })?;
    drop(main);
    let outcome = system.run();
    std::fs::remove_file(&file)?;
    outcome.map(drop)
}
