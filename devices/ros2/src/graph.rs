//! The connections, as DDS discovers them.

use crate::Status;
use crate::qos::disagreement;
use ros2_client::dds::rustdds::{DomainParticipantStatusEvent, EndpointDescription, GUID};
use std::collections::{HashMap, HashSet};

/// What the node has, and what is known of others.
#[derive(Default)]
pub(crate) struct Graph {
    watched: Vec<Watched>,
    /// The topics of remote readers and writers.
    topics: HashMap<GUID, String>,
}

/// A link's reader or writer, or both of a service.
pub(crate) struct Watched {
    pub(crate) status: Status,
    pub(crate) sides: Vec<Side>,
}

pub(crate) struct Side {
    pub(crate) role: Role,
    /// A service's is not known, so its topic decides.
    pub(crate) guid: Option<GUID>,
    pub(crate) topic: String,
    pub(crate) kind: String,
    pub(crate) partners: HashSet<GUID>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    Writer,
    Reader,
}

impl Graph {
    pub(crate) fn watch(&mut self, watched: Watched) {
        self.watched.push(watched);
    }

    pub(crate) fn forget(&mut self, status: &Status) {
        self.watched
            .retain(|watched| !watched.status.is_same(status));
    }

    pub(crate) fn take(&mut self, event: DomainParticipantStatusEvent) {
        use DomainParticipantStatusEvent as Event;
        match event {
            Event::ReaderDetected { reader } => self.detected(Role::Writer, reader),
            Event::WriterDetected { writer } => self.detected(Role::Reader, writer),
            Event::RemoteReaderMatched {
                local_writer,
                remote_reader,
            } => self.matched(Role::Writer, local_writer, remote_reader),
            Event::RemoteWriterMatched {
                local_reader,
                remote_writer,
            } => self.matched(Role::Reader, local_reader, remote_writer),
            Event::ReaderLost { guid, .. } | Event::WriterLost { guid, .. } => self.lost(guid),
            Event::RemoteReaderQosIncompatible {
                local_writer,
                requested_qos,
                offered_qos,
                ..
            } => self.disagree(
                local_writer,
                "a subscription",
                disagreement(&offered_qos, &requested_qos),
            ),
            Event::RemoteWriterQosIncompatible {
                local_reader,
                requested_qos,
                offered_qos,
                ..
            } => self.disagree(
                local_reader,
                "a publisher",
                disagreement(&offered_qos, &requested_qos),
            ),
            _ => {}
        }
    }

    /// A reader for our writers of its topic, or a writer for our readers.
    fn detected(&mut self, ours: Role, remote: EndpointDescription) {
        for watched in &self.watched {
            for side in &watched.sides {
                if side.role == ours
                    && side.topic == remote.topic_name
                    && side.kind != remote.type_name
                {
                    watched.status.incompatible_one(format!(
                        "`{}` has the type `{}` there, and `{}` here",
                        side.topic, remote.type_name, side.kind
                    ));
                }
            }
        }
        self.topics.insert(remote.guid, remote.topic_name);
    }

    fn matched(&mut self, ours: Role, local: GUID, remote: GUID) {
        let topic = self.topics.get(&remote);
        for watched in &mut self.watched {
            for side in &mut watched.sides {
                let is_it = match side.guid {
                    Some(guid) => guid == local,
                    None => topic == Some(&side.topic),
                };
                if side.role == ours && is_it {
                    side.partners.insert(remote);
                }
            }
            watched.count();
        }
    }

    fn lost(&mut self, remote: GUID) {
        self.topics.remove(&remote);
        for watched in &mut self.watched {
            for side in &mut watched.sides {
                side.partners.remove(&remote);
            }
            watched.count();
        }
    }

    fn disagree(&mut self, local: GUID, whom: &str, what: String) {
        for watched in &self.watched {
            let side = watched.sides.iter().find(|side| side.guid == Some(local));
            if let Some(side) = side {
                let topic = &side.topic;
                let status = &watched.status;
                status.incompatible_one(format!("{whom} of `{topic}` does not fit: {what}"));
            }
        }
    }
}

impl Watched {
    /// A partner of a service has both sides.
    fn count(&self) {
        let partners = self.sides.iter().map(|side| side.partners.len()).min();
        self.status.set_partners(partners.unwrap_or(0));
    }
}
