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
        // Of the styles the scope's page takes none, but for the dark theme, which it has itself.
        ("<style", 1),
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

/// The numbers of an attribute.
fn numbers(text: &str) -> Vec<f64> {
    let words = text.split(|letter: char| !matches!(letter, '0'..='9' | '.' | '-'));
    words.filter_map(|word| word.parse().ok()).collect()
}

/// Points of a line, to its end: without its head.
fn points(line: &str) -> Vec<(f64, f64)> {
    let (_, rest) = line.split_once(" d=\"M").unwrap();
    let path = rest.split('"').next().unwrap();
    let path = path.split('M').next().unwrap();
    let mut points: Vec<(f64, f64)> = Vec::new();
    for piece in path.split_inclusive(|letter: char| letter.is_ascii_alphabetic()) {
        let at = numbers(piece)
            .chunks(2)
            .map(|two| (two[0], two[1]))
            .collect::<Vec<_>>();
        points.extend(at);
    }
    if path.contains('C') {
        let [a, b, c, d] = points[..] else {
            panic!("{path}");
        };
        let at = |t: f64| {
            let u = 1.0 - t;
            let of = |a, b, c, d| {
                u * u * u * a + 3.0 * u * u * t * b + 3.0 * u * t * t * c + t * t * t * d
            };
            (of(a.0, b.0, c.0, d.0), of(a.1, b.1, c.1, d.1))
        };
        return (0..=40).map(|n| at(f64::from(n) / 40.0)).collect();
    }
    points
}

/// Whether a line comes into a box, but for a pixel at its edge.
fn goes_through(points: &[(f64, f64)], [x, y, width, height]: [f64; 4]) -> bool {
    points.windows(2).any(|two| {
        let ((x1, y1), (x2, y2)) = (two[0], two[1]);
        (0..=50).map(|n| f64::from(n) / 50.0).any(|t| {
            let (px, py) = (x1 + (x2 - x1) * t, y1 + (y2 - y1) * t);
            px > x + 1.0 && px < x + width - 1.0 && py > y + 1.0 && py < y + height - 1.0
        })
    })
}

/// Of the examples, and of a ring whose last line leads back past all others.
#[test]
fn no_line_goes_through_a_box_and_no_label_stands_on_one() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/models");
    let mut drawings = vec![ring(8).to_svg()];
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        drawings.push(Model::parse("m.toml", &text).unwrap().to_svg());
    }
    assert!(drawings.len() > 5);
    for svg in drawings {
        let processes = boxes(&svg, "p");
        let name = svg.lines().nth(1).unwrap().to_owned();
        let mut labels: Vec<[f64; 4]> = Vec::new();
        for line in svg.lines().filter(|line| line.contains("class=\"a\"")) {
            let points = points(line);
            for one in &processes {
                assert!(!goes_through(&points, *one), "{name}: {line} {one:?}");
            }
            let (_, label) = line.split_once("class=\"label\"").unwrap();
            let (_, label) = label.split_once("<text ").unwrap();
            let (place, text) = label.split_once('>').unwrap();
            let [x, y] = numbers(place)[..] else {
                panic!("{place}");
            };
            let width = text.split('<').next().unwrap().chars().count() as f64 * 5.0;
            labels.push([x - width / 2.0, y - 7.0, width, 8.0]);
        }
        for (at, a) in labels.iter().enumerate() {
            for b in labels[..at].iter().chain(&processes) {
                let apart = |axis: usize| {
                    a[axis] + a[axis + 2] <= b[axis] || b[axis] + b[axis + 2] <= a[axis]
                };
                assert!(apart(0) || apart(1), "{name}: {a:?} {b:?}");
            }
        }
    }
}

/// As `luna model from` writes it: all processes side by side.
#[test]
fn many_processes_stand_together_by_their_names() {
    let parts = ["feeder", "feeder_belt", "robot"].map(|unit| {
        let part = |what| format!("{unit}_{what} = {{ process = \"P\" }}\n");
        ["safety", "control", "command", "motor"].map(part).concat()
    });
    let text = |more: &str| {
        format!(
            "[process.P]\nbody = \"loop {{ act }}\"\n[system.part]\n{}{more}",
            parts.concat()
        )
    };
    let model = |text: &str| Model::parse("flat.toml", text).unwrap();
    let svg = model(&text("operator = { process = \"P\" }\n")).to_svg();
    // The system, and the three units.
    assert_eq!(boxes(&svg, "g").len(), 4);
    assert!(svg.contains("font-weight=\"bold\">feeder</text>"), "{svg}");
    // Few need none, and places that are stated stay.
    let few = text("").lines().take(3 + 8).collect::<Vec<_>>().join("\n");
    assert_eq!(boxes(&model(&few).to_svg(), "g").len(), 1);
    let placed = text("operator = { process = \"P\", at = [0, 0] }\n");
    assert_eq!(boxes(&model(&placed).to_svg(), "g").len(), 1);
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
