//! A system's parameters, as the graph sees them.

use crate::{domain, node};
use luna::prelude::*;
use luna_ros2::Link;
use luna_ros2::Node;
use luna_ros2::Service;
use luna_ros2::msg::rcl_interfaces::{
    DescribeParameters, DescribeParametersRequest, GetParameterTypes, GetParameterTypesRequest,
    GetParameters, GetParametersRequest, ListParameters, ListParametersRequest, Parameter,
    ParameterValue, SetParameters, SetParametersAtomically, SetParametersAtomicallyRequest,
    SetParametersRequest,
};

type Caller<S> = luna::channel::Client<<S as Service>::Request, <S as Service>::Reply>;

fn client<S: Service>(node: &Node, name: &str, links: &mut Vec<Link>) -> Caller<S> {
    let (client, link) = node.client::<S>(&format!("/camera/{name}")).unwrap();
    links.push(link);
    client
}

fn double(name: &str, value: f64) -> Parameter {
    Parameter {
        name: name.to_owned(),
        value: ParameterValue {
            r#type: ParameterValue::DOUBLE,
            double_value: value,
            ..Default::default()
        },
    }
}

#[test]
fn parameters_are_listed_described_read_and_set() {
    own_process!();
    let domain = domain();
    let (camera, tool) = (node(domain, "camera"), node(domain, "tool"));
    let mut links = Vec::new();
    let list = client::<ListParameters>(&tool, "list_parameters", &mut links);
    let get = client::<GetParameters>(&tool, "get_parameters", &mut links);
    let types = client::<GetParameterTypes>(&tool, "get_parameter_types", &mut links);
    let describe = client::<DescribeParameters>(&tool, "describe_parameters", &mut links);
    let set = client::<SetParameters>(&tool, "set_parameters", &mut links);
    let all = "set_parameters_atomically";
    let all = client::<SetParametersAtomically>(&tool, all, &mut links);
    let found: Vec<_> = links.iter().map(Link::status).collect();

    let mut system = System::new("camera");
    let main = system.executor("main").build().unwrap();
    let pan = main.process("pan");
    let kp = pan.parameter("pan/kp", 2.0).unit("1/rad").range(0.0..=50.0);
    let kp = kp.description("gain").register().unwrap();
    let count = pan.parameter("count", 7_u8).register().unwrap();
    let gains = pan.parameter("gains", [1.0, 2.0]).register().unwrap();
    let on = pan.parameter("on", true).register().unwrap();
    let (served, link) = camera.parameters(system.parameters()).unwrap();
    let offered = link.status();
    main.process("parameters").priority(2).spawn(link).unwrap();
    for (number, link) in links.into_iter().enumerate() {
        let name = format!("link {number}");
        main.process(&name).priority(2).spawn(link).unwrap();
    }
    pan.spawn(async move {
        let _served = served;
        for status in &found {
            status.wait_for_partners(1).await;
        }
        // The last of the six.
        offered.wait_for_partners(1).await;
        let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        let asked = ListParametersRequest::default();
        let listed = list.call(asked).await.unwrap().result;
        assert_eq!(listed.names, ["count", "gains", "on", "pan.kp"]);
        assert_eq!(listed.prefixes, ["pan"]);
        let asked = ListParametersRequest {
            prefixes: names(&["pan"]),
            depth: 1,
        };
        assert_eq!(list.call(asked).await.unwrap().result.names, ["pan.kp"]);

        let all_names: Vec<String> = names(&["pan.kp", "count", "gains", "on", "none"]);
        let asked = GetParametersRequest {
            names: all_names.clone(),
        };
        let values = get.call(asked).await.unwrap().values;
        assert_eq!(values[0].double_value, 2.0);
        assert_eq!(values[1].integer_value, 7);
        assert_eq!(values[2].double_array_value, [1.0, 2.0]);
        assert!(values[3].bool_value);
        assert_eq!(values[4].r#type, ParameterValue::NOT_SET);
        let asked = GetParameterTypesRequest { names: all_names };
        let kinds = types.call(asked).await.unwrap().types;
        assert_eq!(kinds, [3, 2, 8, 1, 0]);

        let asked = DescribeParametersRequest {
            names: names(&["pan.kp"]),
        };
        let described = describe.call(asked).await.unwrap().descriptors.remove(0);
        assert_eq!(described.description, "gain [1/rad]");
        assert_eq!(described.floating_point_range[0].to_value, 50.0);

        let parameters = vec![double("pan.kp", 3.5), double("pan.kq", 1.0)];
        let results = set.call(SetParametersRequest { parameters }).await.unwrap();
        assert!(results.results[0].successful);
        let reason = &results.results[1].reason;
        assert!(reason.contains("no such parameter"), "{reason}");
        kp.latch();
        assert_eq!(kp.get(), 3.5);

        let parameters = vec![double("pan.kp", 4.0), double("count", 300.0)];
        let request = SetParametersAtomicallyRequest { parameters };
        let result = all.call(request).await.unwrap().result;
        assert!(
            !result.successful && result.reason.contains("count"),
            "{result:?}"
        );
        kp.latch();
        assert_eq!(kp.get(), 3.5);
        let _ = (count.get(), gains.get(), on.get());
        Ok(())
    })
    .unwrap();
    system.run().unwrap();
}
