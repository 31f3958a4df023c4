//! Random models, as text.

use std::fmt::Write;

/// SplitMix64.
#[derive(Debug)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) % limit as u64) as usize
    }

    fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }
}

#[derive(Debug, Clone)]
struct Port {
    name: String,
    sends: bool,
    has_values: bool,
}

/// Two to four processes with bodies over one to four channels.
pub(crate) fn model(random: &mut Random) -> String {
    let processes = 2 + random.below(3);
    let channels = 1 + random.below(4);
    let mut ports = vec![Vec::new(); processes];
    let mut binds = vec![String::new(); processes];
    let mut text = String::new();
    for channel in 0..channels {
        let has_values = random.one_in(2);
        let buffer = match random.below(6) {
            0 => format!("fifo {}", 1 + random.below(2)),
            1 => format!("overwrite_oldest {}", 1 + random.below(2)),
            2 => format!("overwrite_newest {}", 1 + random.below(3)),
            _ => "rendezvous".to_owned(),
        };
        let kind = if has_values { "0..2" } else { "()" };
        let _ = writeln!(
            text,
            "[system.channel.c{channel}]\nbuffer = \"{buffer}\"\ntype = \"{kind}\""
        );
        let sender = random.below(processes);
        let receiver = (sender + 1 + random.below(processes - 1)) % processes;
        let mut ends = vec![(sender, true), (receiver, false)];
        // Several senders or receivers now and then.
        if random.one_in(4) {
            let more = (random.below(processes), random.one_in(2));
            if !ends.contains(&more) {
                ends.push(more);
            }
        }
        for (process, sends) in ends {
            let side = if sends { "s" } else { "r" };
            let name = format!("{side}{channel}");
            let _ = writeln!(binds[process], "bind.{name} = \"c{channel}\"");
            ports[process].push(Port {
                name,
                sends,
                has_values,
            });
        }
    }
    for (process, ports) in ports.iter().enumerate() {
        let mut body = Body {
            random,
            ports,
            loops: 0,
        };
        let body = body.block(3, true);
        let _ = writeln!(
            text,
            "[process.P{process}]\nvariables = {{ x = \"0..2\", y = \"0..2\" }}"
        );
        let _ = writeln!(
            text,
            "body = \"\"\"\n{body}\n\"\"\"\n[process.P{process}.ports]"
        );
        for port in ports {
            let side = if port.sends { "send" } else { "receive" };
            let _ = writeln!(text, "{} = \"{side}\"", port.name);
        }
        let _ = writeln!(text, "[system.part.p{process}]\nprocess = \"P{process}\"");
        text.push_str(&binds[process]);
    }
    text
}

struct Body<'a> {
    random: &'a mut Random,
    ports: &'a [Port],
    loops: usize,
}

impl Body<'_> {
    /// Branches of `par` have no variables: what one sets no other may use.
    fn block(&mut self, depth: usize, variables: bool) -> String {
        let count = 1 + self.random.below(3);
        let parts: Vec<String> = (0..count)
            .map(|_| self.statement(depth, variables))
            .collect();
        parts.join("; ")
    }

    fn statement(&mut self, depth: usize, variables: bool) -> String {
        let kind = match depth {
            0 => self.random.below(7),
            _ => self.random.below(16),
        };
        let inner = depth.saturating_sub(1);
        match kind {
            0..=3 => self.offer(variables),
            4 => "act".to_owned(),
            5 if variables => {
                let value = self.value(variables);
                format!("x = ({value}) % 3")
            }
            6 if variables && self.random.one_in(6) => "assert x <= 1 || y == 0".to_owned(),
            6 if self.random.one_in(12) => "stop".to_owned(),
            5 | 6 => "skip".to_owned(),
            7 | 8 => {
                // What is done again begins with what takes part in the network.
                let (first, rest) = (self.offer(variables), self.block(inner, variables));
                format!("loop {{ {first}; {rest} }}")
            }
            9 => {
                let (left, right) = (self.block(inner, variables), self.block(inner, variables));
                format!("choose {{ {left} | {right} }}")
            }
            10 => {
                let (left, right) = (self.block(inner, false), self.block(inner, false));
                format!("par {{ {left} | {right} }}")
            }
            11 => {
                let condition = self.condition(variables);
                let (left, right) = (self.block(inner, variables), self.block(inner, variables));
                format!("if {condition} {{ {left} }} else {{ {right} }}")
            }
            12 => {
                self.loops += 1;
                let (name, body) = (self.loops, self.block(inner, variables));
                format!("for k{name} in 0..2 {{ {body} }}")
            }
            _ => self.alternative(inner, variables),
        }
    }

    fn alternative(&mut self, depth: usize, variables: bool) -> String {
        let count = 1 + self.random.below(3);
        let guards: Vec<String> = (0..count)
            .map(|_| {
                let mut guard = match self.random.below(8) {
                    0 => ["skip", "after"][self.random.below(2)].to_owned(),
                    _ => self.offer(variables),
                };
                if guard == "act" {
                    guard = "after".to_owned();
                }
                let condition = match self.random.one_in(3) {
                    true => format!(" if {}", self.condition(variables)),
                    false => String::new(),
                };
                let body = self.block(depth, variables);
                format!("{guard}{condition} => {body}")
            })
            .collect();
        format!("alt {{ {} }}", guards.join(" | "))
    }

    fn offer(&mut self, variables: bool) -> String {
        if self.ports.is_empty() {
            return "act".to_owned();
        }
        let port = self.ports[self.random.below(self.ports.len())].clone();
        match (port.sends, port.has_values) {
            (true, true) => {
                let value = self.value(variables);
                // Out of range now and then.
                let modulo = if self.random.one_in(15) { "" } else { " % 3" };
                format!("{}!({value}){modulo}", port.name)
            }
            (true, false) => format!("{}!", port.name),
            (false, true) if variables => {
                let variable = ["x", "y", ""][self.random.below(3)];
                format!("{}?{variable}", port.name)
            }
            (false, _) => format!("{}?", port.name),
        }
    }

    fn value(&mut self, variables: bool) -> String {
        match self.random.below(5) {
            0 if variables => "x".to_owned(),
            1 if variables => "x + y".to_owned(),
            2 if variables => "y + 1".to_owned(),
            3 if variables && self.random.one_in(8) => "2 / y".to_owned(),
            n => (n % 3).to_string(),
        }
    }

    fn condition(&mut self, variables: bool) -> String {
        match self.random.below(4) {
            0 if variables => "x == 0".to_owned(),
            1 if variables => "x > y".to_owned(),
            2 if variables => "!(y == 1) && x < 2".to_owned(),
            n => (n % 2).to_string(),
        }
    }
}
