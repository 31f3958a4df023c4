//! An `Alternative`, which stays registered with its channels: on either side.

use super::{Numbers, Order, Scene};
use crate::same_core::shared::How;
use luna::{Alternative, Receiver, Sender, channel};

const CHANNELS: usize = 3;

pub(super) fn scenes() -> [Scene; 2] {
    [of_high(), of_low()]
}

fn ends() -> (Vec<Sender<u64>>, Vec<Receiver<u64>>) {
    let ends = (0..CHANNELS).map(|_| channel());
    ends.map(|(sender, receiver)| (sender.external(), receiver))
        .unzip()
}

fn of_high() -> Scene {
    let (senders, receivers) = ends();
    Scene::new(
        "registered, high",
        async move |high| {
            let mut orders = [(); CHANNELS].map(|()| Order::new(false));
            let mut inputs = Alternative::fair(&receivers);
            for _ in 0..high.rounds {
                high.pause().await;
                let chosen = match high.how() {
                    How::Try => {
                        let once = futures_lite::future::poll_once(inputs.recv());
                        high.try_in(once).await
                    }
                    _ => Some(high.wait_for(inputs.recv()).await),
                };
                if let Some((index, value)) = chosen {
                    orders[index].check(value.unwrap());
                }
            }
            receivers.iter().for_each(Receiver::poison);
        },
        async move |low| {
            let mut numbers = [(); CHANNELS].map(|()| Numbers::new());
            while low.goes_on().await {
                let index = low.random.below(CHANNELS as u64) as usize;
                let (sender, numbers) = (&senders[index], &mut numbers[index]);
                if low.random.below(2) == 0 {
                    let number = numbers.take();
                    if let Err(error) = sender.try_send(number) {
                        numbers.give_back(error.into_inner());
                    }
                } else {
                    let _ = low.offer(sender.send_from(numbers.slot())).await;
                }
            }
        },
    )
}

fn of_low() -> Scene {
    let (senders, receivers) = ends();
    Scene::new(
        "registered, low",
        async move |high| {
            let mut numbers = [(); CHANNELS].map(|()| Numbers::new());
            for _ in 0..high.rounds {
                high.pause().await;
                let index = high.random.below(CHANNELS as u64) as usize;
                let (sender, numbers) = (&senders[index], &mut numbers[index]);
                let number = numbers.take();
                match high.how() {
                    How::Try => {
                        if let Err(error) = high.try_to(|| sender.try_send(number)) {
                            numbers.give_back(error.into_inner());
                        }
                    }
                    How::Await => high.wait_for(sender.send(number)).await.unwrap(),
                    How::Block => high.block(|| sender.blocking_send(number)).unwrap(),
                }
            }
            senders.iter().for_each(Sender::poison);
        },
        async move |low| {
            let mut orders = [(); CHANNELS].map(|()| Order::new(false));
            let mut inputs = Alternative::fair(&receivers);
            while low.goes_on().await {
                if let Some((index, Ok(value))) = low.offer(inputs.recv()).await {
                    orders[index].check(value);
                }
            }
        },
    )
}
