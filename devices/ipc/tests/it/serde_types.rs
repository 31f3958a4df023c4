//! Types of serde.

use crate::shared::watchdog;
use crate::{channel_name, files, run, spawn};
use luna::Policy;
use luna_ipc::Endpoint;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Order {
    Stop,
    Make { part: String, steps: Vec<u16> },
}

fn orders() -> Vec<Order> {
    let make = |steps: u16| Order::Make {
        part: "bracket".repeat(usize::from(steps)),
        steps: (0..steps).collect(),
    };
    vec![Order::Stop, make(0), make(5), Order::Stop, make(20)]
}

#[test]
fn strings_and_vectors_cross() {
    let _watchdog = watchdog();
    let name = channel_name("orders");
    let endpoint = Endpoint::new(&name);
    let (receiver, link) = endpoint.serde_receiver::<Order>(512).unwrap();
    let received = spawn(Policy::Other, link, async move {
        for order in orders() {
            assert_eq!(receiver.recv().await?, order);
        }
        Ok(())
    });
    let (sender, link) = endpoint.serde_sender::<Order>(512).unwrap();
    run(Policy::Other, link, async move {
        for order in orders() {
            sender.send(order).await?;
        }
        Ok(())
    })
    .unwrap();
    received.join().unwrap().unwrap();
    assert!(files(&name).is_empty());
}

#[test]
fn a_value_that_is_too_large_goes_back_and_ends_both_links() {
    let _watchdog = watchdog();
    let name = channel_name("too-large");
    let endpoint = Endpoint::new(&name);
    let (receiver, link) = endpoint.serde_receiver::<String>(16).unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert_eq!(receiver.recv().await?, "fits");
        assert!(receiver.recv().await.unwrap_err().is_poisoned());
        Ok(())
    });
    let (sender, link) = endpoint.serde_sender::<String>(16).unwrap();
    let sent = run(Policy::Other, link, async move {
        sender.send("fits".to_owned()).await?;
        let error = sender.send("much too large to fit".to_owned()).await;
        assert_eq!(error.unwrap_err().into_inner(), "much too large to fit");
        Ok(())
    });
    let error = sent.unwrap_err().to_string();
    assert!(error.contains("cannot be encoded"), "{error}");
    assert!(received.join().unwrap().unwrap_err().is_poisoned());
}

#[test]
fn values_that_cannot_be_decoded_end_both_links() {
    /// Has the same name for the programs, and decodes nothing that the other side writes.
    #[derive(Debug, Serialize)]
    struct Picky(u32);
    impl<'de> Deserialize<'de> for Picky {
        fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
            u32::deserialize(from)?;
            Err(serde::de::Error::custom("refused"))
        }
    }
    let _watchdog = watchdog();
    let name = channel_name("picky");
    let endpoint = Endpoint::new(&name);
    let (receiver, link) = endpoint.serde_receiver::<Picky>(16).unwrap();
    let received = spawn(Policy::Other, link, async move {
        assert!(receiver.recv().await.unwrap_err().is_poisoned());
        Ok(())
    });
    let (sender, link) = endpoint.serde_sender::<Picky>(16).unwrap();
    let sent = run(Policy::Other, link, async move {
        let error = sender.send(Picky(3)).await.unwrap_err();
        assert!(error.is_poisoned());
        assert_eq!(error.into_inner().0, 3);
        Ok(())
    });
    assert!(sent.unwrap_err().is_poisoned());
    let error = received.join().unwrap().unwrap_err().to_string();
    assert!(error.contains("cannot be decoded"), "{error}");
}

#[test]
fn plain_and_serde_and_other_capacities_are_different_types() {
    let name = channel_name("capacity");
    let endpoint = Endpoint::new(&name);
    let (_sender, _link) = endpoint.serde_sender::<u64>(8).unwrap();
    let error = endpoint.serde_receiver::<u64>(16).unwrap_err().to_string();
    assert!(
        error.contains("16 bytes") && error.contains("8 bytes"),
        "{error}"
    );
    let error = endpoint.receiver::<u64>().unwrap_err().to_string();
    assert!(error.contains("by postcard"), "{error}");
    drop(endpoint.serde_receiver::<u64>(8).unwrap());
}
