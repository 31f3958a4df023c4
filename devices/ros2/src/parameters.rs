//! LUNA's parameters as those of a ROS 2 node.

use crate::carrier::Stop;
use crate::graph::{Side, Watched};
use crate::link::Link;
use crate::message::{Payload, Wire};
use crate::msg::rcl_interfaces::{
    DescribeParameters, DescribeParametersReply, FloatingPointRange, GetParameterTypes,
    GetParameterTypesReply, GetParameters, GetParametersReply, IntegerRange, ListParameters,
    ListParametersReply, ListParametersRequest, ListParametersResult, Parameter,
    ParameterDescriptor, ParameterValue, SetParameters, SetParametersAtomically,
    SetParametersAtomicallyReply, SetParametersReply, SetParametersResult,
};
use crate::service::RosServer;
use crate::{Node, Ros2Error, Service, Status, names};
use futures_lite::StreamExt;
use futures_lite::future::or;
use luna::Sender;
use luna::parameters::{Info, Parameters, SetError, Value};

impl Node {
    /// Offers the parameters of a system as those of the node, so that `ros2 param list`, `get`,
    /// `set` and `describe` work on them: the services `~/list_parameters`, `get_parameters`,
    /// `get_parameter_types`, `set_parameters`, `set_parameters_atomically` and
    /// `describe_parameters`.
    ///
    /// A `/` in a name is a `.` there: `pan/kp` is `pan.kp`. Numbers with a fraction are doubles,
    /// whole ones integers, choices strings, arrays arrays. Ranges are described. A set is checked
    /// as [`Parameters::set`] does it, and the reason of a refusal is its text. A process sees a
    /// set when its next cycle begins.
    ///
    /// Not there: parameters that are made or deleted by the graph, the topic
    /// `/parameter_events`, and whole numbers above 2⁶³.
    ///
    /// Requests are served by the link's thread, until the sender that is returned is dropped: it
    /// goes into the process that the parameters belong to, or into any other.
    ///
    /// Not for the real-time path: as [`publisher`](Self::publisher).
    ///
    /// # Errors
    ///
    /// As for [`publisher`](Self::publisher).
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna_ros2::{Node, Options};
    ///
    /// let mut system = System::new("camera");
    /// let node = Node::new("/", "camera", Options::new().domain(81))?;
    /// let main = system.executor("main").build()?;
    /// let pan = main.process("pan");
    /// let kp = pan.parameter("pan/kp", 2.0).range(0.0..=50.0).register()?;
    /// let (served, link) = node.parameters(system.parameters())?;
    /// main.process("parameters").spawn(link)?;
    /// pan.spawn(async move {
    ///     let _served = served;
    ///     println!("{}", kp.get()); // `ros2 param set /camera pan.kp 3.0` changes it
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn parameters(&self, parameters: Parameters) -> Result<(Sender<()>, Link), Ros2Error> {
        let status = Status::new();
        // Under the lock, so that no match is missed.
        let mut graph = self.inner.graph();
        let mut sides = Vec::new();
        let get = self.offer::<GetParameters>("get_parameters", &mut sides)?;
        let types = self.offer::<GetParameterTypes>("get_parameter_types", &mut sides)?;
        let set = self.offer::<SetParameters>("set_parameters", &mut sides)?;
        let atomically = "set_parameters_atomically";
        let all = self.offer::<SetParametersAtomically>(atomically, &mut sides)?;
        let list = self.offer::<ListParameters>("list_parameters", &mut sides)?;
        let describe = self.offer::<DescribeParameters>("describe_parameters", &mut sides)?;
        graph.watch(Watched {
            status: status.clone(),
            sides,
        });
        drop(graph);
        let (served, last) = luna::channel::<()>();
        let (served, last) = (served.external(), last.external());
        let counts = status.clone();
        let work = move |stop: &Stop| {
            let (own, counts) = (&parameters, &counts);
            let get = answer(&get, counts, |asked| GetParametersReply {
                values: each(own, &asked.names, |info| {
                    info.map(value).unwrap_or_default()
                }),
            });
            let types = answer(&types, counts, |asked| GetParameterTypesReply {
                types: each(own, &asked.names, |info| info.map_or(0, kind)),
            });
            let set = answer(&set, counts, |asked| SetParametersReply {
                results: asked
                    .parameters
                    .into_iter()
                    .map(|one| replace(own, vec![one]))
                    .collect(),
            });
            let all = answer(&all, counts, |asked| SetParametersAtomicallyReply {
                result: replace(own, asked.parameters),
            });
            let list = answer(&list, counts, |asked| ListParametersReply {
                result: listed(own, &asked),
            });
            let describe = answer(&describe, counts, |asked| DescribeParametersReply {
                descriptors: asked
                    .names
                    .iter()
                    .map(|name| described(own, name))
                    .collect(),
            });
            let end = async {
                last.ended().await;
            };
            let first = or(end, or(get, or(types, set)));
            stop.wait(or(first, or(all, or(list, describe))));
            Ok(())
        };
        let name = format!("parameters of {}", self.name());
        let link = Link::new(self.inner.clone(), name, status, Box::new(work));
        Ok((served, link))
    }

    fn offer<S: Service>(
        &self,
        name: &str,
        sides: &mut Vec<Side>,
    ) -> Result<RosServer<S::Request, S::Reply>, Ros2Error> {
        let name = names::resolve(&format!("~/{name}"), &self.inner.name, "service")?;
        let kind = names::service(S::TYPE)?;
        let (server, both) = self.inner.serve(&name, &kind)?;
        sides.extend(both);
        Ok(server)
    }
}

/// Answers requests until DDS ends.
async fn answer<Q: Payload, A: Payload>(
    server: &RosServer<Q, A>,
    status: &Status,
    reply: impl Fn(Q) -> A,
) {
    let mut requests = server.receive_request_stream();
    while let Some(request) = requests.next().await {
        match request {
            Ok((id, Wire(request))) => {
                status.carry();
                let sent = server.async_send_response(id, Wire(reply(request))).await;
                if let Err(error) = sent {
                    status.refuse(error);
                }
            }
            Err(error) => status.malformed_one(error),
        }
    }
    // The others may go on.
    std::future::pending::<()>().await;
}

fn ros_name(name: &str) -> String {
    name.replace('/', ".")
}

/// Of each name what is known of its parameter.
fn each<T>(own: &Parameters, names: &[String], make: impl Fn(Option<&Info>) -> T) -> Vec<T> {
    let infos = own.list();
    let find = |name: &String| infos.iter().find(|info| ros_name(&info.name) == *name);
    names.iter().map(|name| make(find(name))).collect()
}

fn value(info: &Info) -> ParameterValue {
    let mut result = ParameterValue {
        r#type: kind(info),
        ..Default::default()
    };
    let whole = |number: i128| i64::try_from(number).unwrap_or(i64::MAX);
    let list = match &info.value {
        Value::Float(number) => {
            result.double_value = *number;
            return result;
        }
        Value::Integer(number) => {
            result.integer_value = whole(*number);
            return result;
        }
        Value::Bool(is) => {
            result.bool_value = *is;
            return result;
        }
        Value::Text(text) | Value::Written(text) => {
            result.string_value = text.clone();
            return result;
        }
        Value::List(list) => list,
        _ => return ParameterValue::default(),
    };
    for element in list {
        match element {
            Value::Float(number) => result.double_array_value.push(*number),
            Value::Integer(number) => result.integer_array_value.push(whole(*number)),
            Value::Bool(is) => result.bool_array_value.push(*is),
            other => result.string_array_value.push(other.to_string()),
        }
    }
    result
}

fn kind(info: &Info) -> u8 {
    let of = |value: &Value| match value {
        Value::Float(_) => ParameterValue::DOUBLE,
        Value::Integer(_) => ParameterValue::INTEGER,
        Value::Bool(_) => ParameterValue::BOOL,
        _ => ParameterValue::STRING,
    };
    match &info.value {
        Value::List(list) => match list.first().map_or(ParameterValue::DOUBLE, of) {
            ParameterValue::BOOL => ParameterValue::BOOL_ARRAY,
            ParameterValue::INTEGER => ParameterValue::INTEGER_ARRAY,
            ParameterValue::DOUBLE => ParameterValue::DOUBLE_ARRAY,
            _ => ParameterValue::STRING_ARRAY,
        },
        one => of(one),
    }
}

/// As LUNA sets it; `None` if it has no such value.
fn given(value: ParameterValue) -> Option<Value> {
    Some(match value.r#type {
        ParameterValue::BOOL => value.bool_value.into(),
        ParameterValue::INTEGER => value.integer_value.into(),
        ParameterValue::DOUBLE => value.double_value.into(),
        ParameterValue::STRING => value.string_value.into(),
        ParameterValue::BYTE_ARRAY => value.byte_array_value.into(),
        ParameterValue::BOOL_ARRAY => value.bool_array_value.into(),
        ParameterValue::INTEGER_ARRAY => value.integer_array_value.into(),
        ParameterValue::DOUBLE_ARRAY => value.double_array_value.into(),
        ParameterValue::STRING_ARRAY => value.string_array_value.into(),
        _ => return None,
    })
}

/// Sets all of these, or none.
fn replace(own: &Parameters, wanted: Vec<Parameter>) -> SetParametersResult {
    let refused = |reason: String| SetParametersResult {
        successful: false,
        reason,
    };
    let infos = own.list();
    let mut values = Vec::new();
    for Parameter { name, value } in wanted {
        // An unknown name stays as it is, so that the refusal has it.
        let known = infos.iter().find(|info| ros_name(&info.name) == name);
        let name = known.map_or(name, |info| info.name.clone());
        match given(value) {
            Some(value) => values.push((name, value)),
            None => return refused(format!("`{name}` cannot be deleted")),
        }
    }
    match own.set(values) {
        Ok(_) => SetParametersResult {
            successful: true,
            reason: String::new(),
        },
        Err(SetError::Refused(refusals)) => {
            let reasons = refusals.iter().map(ToString::to_string);
            refused(reasons.collect::<Vec<_>>().join("; "))
        }
        Err(error) => refused(error.to_string()),
    }
}

fn listed(own: &Parameters, asked: &ListParametersRequest) -> ListParametersResult {
    let mut result = ListParametersResult::default();
    for info in own.list() {
        let name = ros_name(&info.name);
        let parts = |text: &str| text.split('.').count() as u64;
        let fits = |below: &str| asked.depth == 0 || parts(below) <= asked.depth;
        let is_asked = match asked.prefixes.is_empty() {
            true => fits(&name),
            false => asked.prefixes.iter().any(|prefix| {
                let below = name.strip_prefix(prefix.as_str());
                let below = below.and_then(|below| below.strip_prefix('.'));
                *prefix == name || below.is_some_and(fits)
            }),
        };
        if !is_asked {
            continue;
        }
        if let Some((prefix, _)) = name.rsplit_once('.') {
            let prefix = prefix.to_owned();
            if !result.prefixes.contains(&prefix) {
                result.prefixes.push(prefix);
            }
        }
        result.names.push(name);
    }
    result
}

fn described(own: &Parameters, name: &str) -> ParameterDescriptor {
    let mut result = ParameterDescriptor {
        name: name.to_owned(),
        ..Default::default()
    };
    let infos = own.list();
    let Some(info) = infos.iter().find(|info| ros_name(&info.name) == name) else {
        return result;
    };
    result.r#type = kind(info);
    result.description = match info.unit.is_empty() {
        true => info.description.clone(),
        false => format!("{} [{}]", info.description, info.unit),
    };
    if !info.choices.is_empty() {
        result.additional_constraints = format!("one of {}", info.choices.join(", "));
    }
    let whole = |number: i128| i64::try_from(number).unwrap_or(i64::MAX);
    match (&info.least, &info.most) {
        (Some(Value::Float(least)), Some(Value::Float(most))) => {
            result.floating_point_range.push(FloatingPointRange {
                from_value: *least,
                to_value: *most,
                step: 0.0,
            });
        }
        (Some(Value::Integer(least)), Some(Value::Integer(most))) => {
            result.integer_range.push(IntegerRange {
                from_value: whole(*least),
                to_value: whole(*most),
                step: 0,
            });
        }
        _ => {}
    }
    result
}
