//! Channels within one program, whether between executors or threads.

use super::{Links, Style};
use crate::messages::Message;
use luna::{Receiver, Sender};
use std::any::Any;
use std::collections::HashMap;

/// Links within one program.
#[derive(Debug, Default)]
pub struct Local {
    /// Ends that nothing has asked for yet.
    left: HashMap<String, Box<dyn Any>>,
}

impl Local {
    /// One end of the channel; the other stays for the next call.
    fn end<T: 'static, O: 'static>(&mut self, name: &str, make: impl FnOnce() -> (T, O)) -> T {
        match self.left.remove(name).map(Box::<dyn Any>::downcast) {
            Some(Ok(end)) => *end,
            Some(Err(_)) => panic!("channel {name} has another type, or its end is taken"),
            None => {
                let (end, other) = make();
                self.left.insert(name.to_owned(), Box::new(other));
                end
            }
        }
    }
}

impl Links for Local {
    fn sender<T: Message>(&mut self, name: &str, style: Style) -> luna::Result<Sender<T>> {
        Ok(self.end(name, || style.channel::<T>(name)))
    }

    fn receiver<T: Message>(&mut self, name: &str, style: Style) -> luna::Result<Receiver<T>> {
        Ok(self.end(name, || {
            let (sender, receiver) = style.channel::<T>(name);
            (receiver, sender)
        }))
    }
}
