//! Drawings: complete, readable, and quick.

use luna_model::Model;
use std::time::{Duration, Instant};

/// A ring of parts, each of them two processes.
fn ring(parts: usize) -> Model {
    let text = format!(
        "name = \"a <ring> & more\"\n\
         [process.Relay]\nports = {{ a = \"receive\", b = \"send\" }}\nbody = \"loop {{ a?; b! }}\"\n\
         [process.Two]\nports = {{ a = \"receive\", b = \"send\" }}\nchannel.c = {{}}\n\
         [process.Two.part]\nfirst = {{ process = \"Relay\", bind = {{ a = \"a\", b = \"c\" }} }}\n\
         second = {{ process = \"Relay\", bind = {{ a = \"c\", b = \"b\" }} }}\n\
         [system.channel]\nring = {{ array = {parts} }}\n\
         [system.part]\ntwo = {{ process = \"Two\", array = {parts}, \
         bind = {{ a = \"ring[i]\", b = \"ring[(i + 1) % {parts}]\" }} }}\n"
    );
    Model::parse("ring.toml", &text).unwrap_or_else(|problem| panic!("{problem}"))
}

#[test]
fn a_thousand_processes_take_less_than_two_seconds() {
    let model = ring(500);
    assert_eq!(model.processes(), 1000);
    let begin = Instant::now();
    let svg = model.to_svg();
    let took = begin.elapsed();
    println!("1000 processes: {took:?}");
    assert!(took < Duration::from_secs(2), "{took:?}");
    assert_eq!(svg.matches("class=\"p\"").count(), 1000);
    assert_eq!(svg.matches("class=\"a\"").count(), 1000);
}

#[test]
fn names_do_not_break_the_formats() {
    let model = ring(2);
    let svg = model.to_svg();
    assert!(
        svg.contains("<title>a &lt;ring&gt; &amp; more</title>"),
        "{svg}"
    );
    assert!(model.to_dot().starts_with("digraph \"a <ring> & more\" {"));
    let mermaid = model.to_mermaid();
    assert!(mermaid.contains("subgraph g1 [\"two#91;0]\"]") || mermaid.contains("[\"two[0]\"]"));
    assert_eq!(mermaid.matches(" --> ").count(), 4);
    assert_eq!(model.to_dot().matches(" -> ").count(), 4);
}

#[test]
fn processes_and_channels_have_their_names_for_the_scope() {
    let text = "name = \"pair\"\n\
        [process.A]\nports = { a = \"send\", b = \"send\" }\nbody = \"loop { a!; b! }\"\n\
        [process.B]\nports = { a = \"receive\", b = \"receive\" }\nbody = \"loop { a?; b? }\"\n\
        [system.channel]\nway = { array = 2 }\nrest = { buffer = \"fifo 3\" }\n\
        over = { buffer = \"overwrite_oldest 1\" }\n\
        [system.part]\n\
        first = { process = \"A\", bind = { a = \"way[0]\", b = \"rest\" } }\n\
        then = { process = \"B\", bind = { a = \"way[0]\", b = \"rest\" } }\n\
        other = { process = \"A\", bind = { a = \"way[1]\", b = \"over\" } }\n\
        last = { process = \"B\", bind = { a = \"way[1]\", b = \"over\" } }\n";
    let model = Model::parse("pair.toml", text).unwrap_or_else(|problem| panic!("{problem}"));
    let svg = model.to_svg();
    for (found, times) in [
        // The box and its text; the arrow and its text.
        ("data-process=\"first\"", 2),
        ("data-channel=\"way[0]; rest\" data-fifo=\"0; 3\"/>", 2),
        ("data-channel=\"way[1]; over\"/>", 2),
        // What the scope's page would leave out.
        ("<style", 0),
        ("marker", 0),
    ] {
        assert_eq!(svg.matches(found).count(), times, "{found}: {svg}");
    }
}

/// Boxes of one part: x, y, width, height.
fn boxes(svg: &str, class: &str) -> Vec<[f64; 4]> {
    let lines = svg
        .lines()
        .filter(|line| line.contains(&format!("class=\"{class}\"")));
    let number = |line: &str, name: &str| {
        let (_, rest) = line.split_once(&format!("class=\"{class}\"")).unwrap();
        let (_, rest) = rest.split_once(&format!(" {name}=\"")).unwrap();
        rest.split('"').next().unwrap().parse().unwrap()
    };
    lines
        .map(|line| ["x", "y", "width", "height"].map(|name| number(line, name)))
        .collect()
}

#[test]
fn boxes_do_not_overlap() {
    let svg = ring(20).to_svg();
    let processes = boxes(&svg, "p");
    assert_eq!(processes.len(), 40);
    for (at, a) in processes.iter().enumerate() {
        for b in &processes[..at] {
            let apart =
                |axis: usize| a[axis] + a[axis + 2] <= b[axis] || b[axis] + b[axis + 2] <= a[axis];
            assert!(apart(0) || apart(1), "{a:?} {b:?}");
        }
    }
    // The first group is the system.
    let groups = boxes(&svg, "g");
    let all = groups[0];
    for a in processes.iter().chain(&groups) {
        assert!(a[0] >= all[0] && a[1] >= all[1], "{a:?} {all:?}");
        assert!(a[0] + a[2] <= all[0] + all[2] + 0.2, "{a:?} {all:?}");
        assert!(a[1] + a[3] <= all[1] + all[3] + 0.2, "{a:?} {all:?}");
    }
}

#[test]
fn a_part_is_where_the_file_places_it() {
    let placed = |at: &str| {
        let text = format!(
            "[process.P]\nbody = \"loop {{ act }}\"\n[system.part]\n\
             one = {{ process = \"P\", at = [0, 0] }}\n\
             many = {{ process = \"P\", array = 3, at = {at} }}\n"
        );
        Model::parse("placed.toml", &text)
    };
    let svg = placed("[300, -40]").unwrap().to_svg();
    let [one, first, second, third] = boxes(&svg, "p")[..] else {
        panic!("{svg}");
    };
    assert_eq!((first[0] - one[0], first[1] - one[1]), (300.0, -40.0));
    assert!(second[1] > first[1] + first[3] && third[1] - second[1] == second[1] - first[1]);
    let [group] = boxes(&svg, "g")[..] else {
        panic!("{svg}");
    };
    for [x, y, width, height] in [one, first, third] {
        assert!(x > group[0] && x + width < group[0] + group[2], "{svg}");
        assert!(y > group[1] && y + height < group[1] + group[3], "{svg}");
    }
    for wrong in ["3", "[1]", "[1, 2, 3]", "[\"a\", 2]", "[1, 100001]"] {
        let problem = placed(wrong).unwrap_err();
        assert_eq!(problem.line, 5, "{problem}");
    }
}
