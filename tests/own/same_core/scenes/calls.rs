//! Call channels: the high side calls, or serves.

use super::Scene;
use crate::same_core::shared::How;
use luna::alt;
use luna::channel::call_channel;

pub(super) fn scenes() -> [Scene; 2] {
    [calls(), serves()]
}

fn calls() -> Scene {
    let (client, server) = call_channel::<u64, u64>();
    let client = client.external();
    Scene::new(
        "call",
        async move |high| {
            for round in 0..u64::from(high.rounds) {
                high.pause().await;
                let answer = match high.how() {
                    // A call ends with the reply if a server takes it, so it may wait for the
                    // server's reply.
                    How::Try => {
                        let choose = async {
                            alt! {
                                answer = client.call(round) => Some(answer.unwrap()),
                                skip => None,
                            }
                        };
                        high.call(choose).await
                    }
                    // The channel knows its server once that has come to accept.
                    How::Await if round == 0 => {
                        Some(high.wait_for(client.call(round)).await.unwrap())
                    }
                    How::Await => Some(high.call(client.call(round)).await.unwrap()),
                    How::Block => Some(high.block(|| client.blocking_call(round)).unwrap()),
                };
                assert!(answer.is_none_or(|answer| answer == round + 1));
            }
            client.poison();
        },
        async move |low| {
            while low.goes_on().await {
                let call = if low.random.below(2) == 0 {
                    server.try_accept().ok()
                } else {
                    low.offer(server.accept()).await.and_then(Result::ok)
                };
                if let Some(call) = call {
                    low.work(300);
                    let answer = *call + 1;
                    let _ = call.reply(answer);
                }
            }
        },
    )
}

fn serves() -> Scene {
    let (client, server) = call_channel::<u64, u64>();
    let server = server.external();
    Scene::new(
        "serve",
        async move |high| {
            for _ in 0..high.rounds {
                high.pause().await;
                let call = match high.how() {
                    How::Try => high.try_to(|| server.try_accept()).ok(),
                    How::Await => Some(high.wait_for(server.accept()).await.unwrap()),
                    How::Block => Some(high.block(|| server.blocking_accept()).unwrap()),
                };
                if let Some(call) = call {
                    if high.random.below(2) == 0 {
                        high.pause().await;
                    }
                    let answer = *call + 1;
                    // The client may have gone.
                    let _ = high.try_to(|| call.reply(answer));
                }
            }
            server.poison();
        },
        async move |low| {
            let mut request = 0;
            while low.goes_on().await {
                request += 1;
                if let Some(Ok(answer)) = low.offer(client.call(request)).await {
                    assert_eq!(answer, request + 1);
                }
            }
        },
    )
}
