//! The sieve of Eratosthenes as a chain of processes that grows while it runs: one filter for each
//! prime found.
//!
//! ```text
//!     numbers --2,3,4,5..--> filter 2 --3,5,7,9..--> filter 3 --5,7,11..--> ...
//! ```
//!
//! The first number that reaches the end of the chain is a prime. The process there reports it,
//! creates a new end behind itself, and then passes on the numbers that its prime does not divide.
//! No process knows the length of the chain.
//!
//! M. D. McIlroy's, for coroutines (1968); as communicating processes in C. A. R. Hoare,
//! Communicating Sequential Processes (1978).

use luna::Executor;
use luna::prelude::*;

const LIMIT: u32 = 2000;

/// The end of the chain. It becomes a filter with the first number that it receives.
async fn sieve(input: Receiver<u32>, primes: Sender<u32>, place: Executor) -> luna::Result<()> {
    let Ok(prime) = input.recv().await else {
        return Ok(()); // no numbers are left: the chain is complete
    };
    primes.send(prime).await?;
    let (output, next) = luna::channel();
    let process = place.process(format!("behind {prime}"));
    // A closure: within `sieve` the compiler does not know yet whether its future is `Send`.
    process.spawn(move || sieve(next, primes, place))?;
    while let Ok(n) = input.recv().await {
        if n % prime != 0 {
            output.send(n).await?;
        }
    }
    Ok(())
}

fn main() -> luna::Result<()> {
    let mut system = System::new("sieve");
    let main = system.executor("main").build()?;
    let (numbers, first) = luna::channel();
    let (primes, found) = luna::channel();

    main.process("numbers").spawn(async move {
        for n in 2..LIMIT {
            numbers.send(n).await?;
        }
        Ok(())
    })?;
    main.process("sieve")
        .spawn(sieve(first, primes, main.clone()))?;
    main.process("printer").spawn(async move {
        let mut count = 0;
        let mut last = 0;
        while let Ok(prime) = found.recv().await {
            assert!(prime > last && (2..prime).all(|n| prime % n != 0));
            last = prime;
            count += 1;
        }
        assert_eq!((count, last), (303, 1999)); // the number of primes below 2000, and the last
        println!("{count} primes below {LIMIT}, the largest is {last}");
        Ok(())
    })?;

    let report = system.run()?;
    assert_eq!(report.processes.len(), 3 + 303); // one process for each prime
    Ok(())
}
