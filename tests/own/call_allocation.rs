//! Calls allocate nothing, wherever their ends run and however they end.

use crate::ALLOCATOR;
use crate::common;

use common::{COMPLETE, has_real_time, watchdog};
use luna::call_channel;
use luna::prelude::*;

#[test]
fn nothing_is_allocated_or_freed_by_calls_on_the_path() {
    own_process!();
    let _watch = watchdog();
    // Where policies are given, the server's thread inherits one too.
    let inherits = COMPLETE && has_real_time();
    let policy = |priority| {
        if inherits {
            Policy::fifo(priority)
        } else {
            Policy::Other
        }
    };
    let mut system = System::new("calls");
    let (client, server) = call_channel::<u64, u64>();
    let (inner, inner_server) = call_channel::<u64, u64>();
    let above = system.executor("above").policy(policy(30)).build().unwrap();
    let below = system.executor("below").policy(policy(20)).build().unwrap();
    above
        .process("client")
        .priority(20)
        .spawn(async move {
            // What the first ones prepare once.
            let mut counted = ALLOCATOR.here();
            for n in 0..2000 {
                if n == 10 {
                    counted = ALLOCATOR.here();
                }
                let answer = client.call(n).await;
                if n % 10 == 0 {
                    assert!(answer.unwrap_err().is_unanswered());
                } else {
                    assert_eq!(answer.unwrap(), n + 1);
                }
                alt! {
                    answer = client.call(1) => assert_eq!(answer.unwrap(), 2),
                }
            }
            assert_eq!(ALLOCATOR.here(), counted);
            Ok(())
        })
        .unwrap();
    below
        .process("middle")
        .priority(3)
        .spawn(async move {
            let counted = ALLOCATOR.here();
            while let Ok(call) = server.accept().await {
                if *call % 10 != 0 {
                    let answer = inner.call(*call).await?;
                    let _ = call.reply(answer);
                }
            }
            assert_eq!(ALLOCATOR.here(), counted);
            Ok(())
        })
        .unwrap();
    below
        .process("server")
        .priority(1)
        .spawn(async move {
            while let Ok(call) = inner_server.accept().await {
                let answer = *call + 1;
                let _ = call.reply(answer);
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    assert_eq!(luna_core::current::refused_boosts(), None);
}
