//! What a composition says of a system, for a model file of it.

use crate::recorded::{MAX_BUFFER, Recorded, RecordedChannel, RecordedExecutor, RecordedProcess};
use luna::inspect::{ChannelKind, ChannelPart, Composition, EndUser, ThreadKind};

impl Recorded {
    /// What a system consists of at this moment. A channel without a name has the place in the
    /// program at which it was made. Of a buffer that overwrites, the model says that it drops its
    /// oldest value.
    ///
    /// Not real-time: it allocates.
    #[must_use]
    pub fn of(parts: &Composition) -> Self {
        let mut found = Self {
            system: parts.system.clone(),
            ..Self::default()
        };
        for thread in &parts.threads {
            let is_thread = thread.kind == ThreadKind::OsThread;
            found.executors.push(RecordedExecutor {
                name: thread.name.clone(),
                is_thread,
                policy: Some(thread.policy.to_string()),
                core: thread.core,
            });
            for process in &thread.processes {
                found.processes.push(RecordedProcess {
                    name: process.name.clone(),
                    priority: (!is_thread).then_some(process.priority),
                    period: None,
                    executor: Some(thread.name.clone()),
                });
            }
        }
        let channels = parts.channels.iter();
        let channels = channels.filter_map(|channel| recorded(&found.processes, channel));
        found.channels = channels.collect();
        found
    }
}

/// How many values a channel can hold; none if it is a barrier or a lock.
pub(super) fn capacity(channel: &ChannelPart) -> Option<usize> {
    match channel.kind {
        ChannelKind::Rendezvous => Some(0),
        ChannelKind::Buffered(values) => Some(values),
        _ => None,
    }
}

/// Those that used an end last or wait at it.
pub(super) fn users(channel: &ChannelPart, sends: bool) -> impl Iterator<Item = &EndUser> {
    let last = match sends {
        true => &channel.sender,
        false => &channel.receiver,
    };
    let waiting = channel
        .waiting
        .iter()
        .filter(move |part| part.sends == sends);
    last.iter().chain(waiting.map(|part| &part.user))
}

fn recorded(processes: &[RecordedProcess], channel: &ChannelPart) -> Option<RecordedChannel> {
    let held = capacity(channel)?;
    let place = |user: &EndUser| match user {
        EndUser::Process(name) => processes.iter().position(|process| process.name == *name),
        _ => None,
    };
    Some(RecordedChannel {
        name: channel.name.as_ref().unwrap_or(&channel.made_at).clone(),
        buffer: (channel.overwrites).then(|| format!("overwrite_oldest {}", held.min(MAX_BUFFER))),
        held,
        least: 0,
        senders: users(channel, true).map(place).collect(),
        receivers: users(channel, false).map(place).collect(),
    })
}
