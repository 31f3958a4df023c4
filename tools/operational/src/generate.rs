//! Random networks. Most steps are planned in pairs, so that communication happens. The rest is
//! chance, so that the networks also meet closed and poisoned channels, partners that never come,
//! and unplanned choices.

use crate::network::{Agent, End, Form, Guard, Kind, Network, Offer, Patience, Side, Step, Value};

/// SplitMix64.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x2545_f491_4f6c_dd1d))
    }

    /// A number below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) % end as u64) as usize
    }

    pub fn chance(&mut self, percent: usize) -> bool {
        self.below(100) < percent
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }
}

/// More agents than this, branches among them, do not make the model's work worth while.
const MAX_AGENTS: usize = 9;
/// The most guards of one alternative: as many as the program that runs networks has places for.
pub const MAX_GUARDS: usize = 3;

/// The network of this seed.
pub fn network(seed: u64) -> Network {
    let mut random = Random::new(seed);
    let processes = 2 + random.below(5);
    let channels = 1 + random.below(4);
    let mut plan = Plan {
        network: Network::default(),
        actors: Vec::new(),
        open_pars: Vec::new(),
        next_value: 0,
        selectors: vec![None; channels],
        levels: random.chance(40),
        wild: random.pick(&[0, 10, 40]),
        random,
    };
    for _ in 0..channels {
        let kind = plan.kind();
        plan.network.channels.push(kind);
    }
    for _ in 0..processes {
        let agent = plan.agent(None);
        plan.actors.push(agent);
    }
    for _ in 0..2 + plan.random.below(3 + processes) {
        plan.extend();
    }
    plan.finish()
}

struct Plan {
    random: Random,
    network: Network,
    /// The agents that can be given another step. If such an agent has begun a parallel construct,
    /// that construct is over.
    actors: Vec<usize>,
    open_pars: Vec<(usize, Vec<usize>)>,
    next_value: Value,
    /// For each channel the agent that receives from it in an `Alternative`.
    selectors: Vec<Option<usize>>,
    levels: bool,
    /// How often something unplanned happens, in percent.
    wild: usize,
}

impl Plan {
    fn kind(&mut self) -> Kind {
        let capacity = 1 + self.random.below(2);
        match self.random.below(10) {
            0..5 => Kind::Rendezvous,
            5..8 => Kind::Fifo(capacity),
            8 => Kind::OverwriteOldest(capacity),
            _ => Kind::OverwriteNewest(capacity),
        }
    }

    fn agent(&mut self, parent: Option<usize>) -> usize {
        let level = match parent {
            Some(parent) => self.network.agents[parent].level,
            None if self.levels => self.random.pick(&[8, 16, 24]),
            None => 16,
        };
        self.network.agents.push(Agent {
            parent,
            strict: self.random.chance(50),
            level,
            ends: Vec::new(),
            steps: Vec::new(),
        });
        self.network.agents.len() - 1
    }

    fn extend(&mut self) {
        let number = self.random.below(100);
        if self.random.chance(self.wild) {
            self.wild_step();
        } else if number < 8 && self.network.agents.len() + 2 <= MAX_AGENTS {
            self.open_par();
        } else if number < 20 && !self.open_pars.is_empty() {
            self.close_par();
        } else if number < 25 {
            self.sync();
        } else {
            self.communication();
        }
    }

    fn push(&mut self, agent: usize, step: Step) {
        self.network.agents[agent].steps.push(step);
    }

    /// A send here and a receive there.
    fn communication(&mut self) {
        let from = self.random.below(self.actors.len());
        let to = (from + 1 + self.random.below(self.actors.len() - 1)) % self.actors.len();
        let (from, to) = (self.actors[from], self.actors[to]);
        let channel = self.random.below(self.network.channels.len());
        let send = self.send(channel);
        let recv = Guard::Recv { channel };
        for (agent, guard) in [(from, send), (to, recv)] {
            let goes_on = match self.network.agents[agent].steps.last() {
                Some(Step::Registered { inputs, .. }) => inputs.contains(&channel),
                _ => false,
            };
            let percent = if goes_on { 80 } else { 15 };
            let step = if agent == to && self.random.chance(percent) {
                self.registered(to, channel)
            } else {
                self.step_around(guard)
            };
            self.push(agent, step);
            if self.random.chance(15) {
                self.push(agent, Step::Yield);
            }
        }
    }

    /// A selection among several inputs. It uses the `Alternative` of the previous selection if
    /// that one has this input too.
    fn registered(&mut self, agent: usize, channel: usize) -> Step {
        match self.network.agents[agent].steps.last() {
            Some(step @ Step::Registered { inputs, .. }) if inputs.contains(&channel) => {
                return step.clone();
            }
            _ => {}
        }
        let mut inputs = vec![channel];
        for other in 0..self.network.channels.len() {
            if other != channel && self.random.chance(40) {
                let place = self.random.below(inputs.len() + 1);
                inputs.insert(place, other);
            }
        }
        // The order of two waits on one channel is decided when they register, which is no step of
        // the model. So there is one at most.
        inputs.retain(|&input| *self.selectors[input].get_or_insert(agent) == agent);
        if inputs.is_empty() {
            return self.step_around(Guard::Recv { channel });
        }
        Step::Registered {
            fair: self.random.chance(50),
            inputs,
        }
    }

    fn send(&mut self, channel: usize) -> Guard {
        self.next_value += 1;
        Guard::Send {
            channel,
            value: self.next_value,
            form: self.random.pick(&[Form::Given, Form::From, Form::With]),
        }
    }

    fn micros(&mut self) -> u32 {
        self.random.pick(&[0, 1, 20, 100, 300])
    }

    /// Some step in which this guard may be chosen.
    fn step_around(&mut self, guard: Guard) -> Step {
        let micros = self.micros();
        match self.random.below(20) {
            0 => Step::Plain(guard, Patience::Try),
            1 => Step::Plain(guard, Patience::Timeout(micros)),
            2 => Step::Plain(guard, Patience::Dropped(micros)),
            3..12 => self.alternative(Some(guard)),
            _ => Step::Plain(guard, Patience::Forever),
        }
    }

    fn alternative(&mut self, guard: Option<Guard>) -> Step {
        let mut offers: Vec<Offer> = guard
            .into_iter()
            .map(|guard| Offer { guard, open: true })
            .collect();
        for _ in 0..self
            .random
            .below(MAX_GUARDS + 1 - offers.len())
            .max(usize::from(offers.is_empty()))
        {
            let guard = self.guard();
            let place = self.random.below(offers.len() + 1);
            let open = self.random.chance(80);
            offers.insert(place, Offer { guard, open });
        }
        let fair = self.random.chance(50);
        Step::Alternative {
            fair,
            offers,
            skip: self.random.chance(15),
            dropped: (!fair && self.random.chance(15)).then(|| self.micros()),
        }
    }

    fn guard(&mut self) -> Guard {
        let channel = self.random.below(self.network.channels.len());
        match self.random.below(20) {
            0..9 => self.send(channel),
            9..17 => Guard::Recv { channel },
            17 if !self.network.barriers.is_empty() => Guard::Sync {
                barrier: self.random.below(self.network.barriers.len()),
            },
            _ => Guard::After(self.micros()),
        }
    }

    /// A step that no other agent counts on.
    fn wild_step(&mut self) {
        let agent = self.random.pick(&self.actors.clone());
        let channel = self.random.below(self.network.channels.len());
        let side = self.random.pick(&[Side::Sender, Side::Receiver]);
        let step = match self.random.below(10) {
            0..2 => Step::Poison(End { channel, side }),
            2 => {
                // Sometimes a barrier that no other agent comes to.
                self.network.barriers.push(1 + self.random.below(2));
                Step::Sync(self.network.barriers.len() - 1)
            }
            3..7 => self.alternative(None),
            _ => {
                let guard = loop {
                    match self.guard() {
                        Guard::Sync { .. } | Guard::After(_) => {}
                        guard => break guard,
                    }
                };
                self.step_around(guard)
            }
        };
        self.push(agent, step);
    }

    /// All agents that can come.
    fn sync(&mut self) {
        self.network.barriers.push(self.actors.len());
        let barrier = self.network.barriers.len() - 1;
        for agent in self.actors.clone() {
            let step = if self.random.chance(30) {
                self.alternative(Some(Guard::Sync { barrier }))
            } else {
                Step::Sync(barrier)
            };
            self.push(agent, step);
        }
    }

    fn open_par(&mut self) {
        let parent = self.actors.remove(self.random.below(self.actors.len()));
        let branches: Vec<usize> = (0..2 + self.random.below(2))
            .map(|_| self.agent(Some(parent)))
            .collect();
        self.push(parent, Step::Par(branches.clone()));
        self.actors.extend(&branches);
        self.open_pars.push((parent, branches));
    }

    /// The innermost of some nest, so that its branches can act.
    fn close_par(&mut self) {
        let closed = self
            .open_pars
            .iter()
            .rposition(|(_, branches)| branches.iter().all(|branch| self.actors.contains(branch)));
        let Some(closed) = closed else { return };
        let (parent, branches) = self.open_pars.remove(closed);
        self.actors.retain(|agent| !branches.contains(agent));
        if self.random.chance(40) {
            let failing = self.random.pick(&branches);
            self.push(failing, Step::Fail);
        }
        self.actors.push(parent);
    }

    fn finish(mut self) -> Network {
        // Ends that are held and not used keep their channels open.
        for agent in 0..self.network.agents.len() {
            if self.random.chance(10) {
                let channel = self.random.below(self.network.channels.len());
                let side = self.random.pick(&[Side::Sender, Side::Receiver]);
                self.network.agents[agent].ends.push(End { channel, side });
            }
        }
        self.network.hand_out_ends();
        for agent in 0..self.network.agents.len() {
            if self.random.chance(15) && !self.network.agents[agent].ends.is_empty() {
                let end = self.random.pick(&self.network.agents[agent].ends.clone());
                self.drop_early(agent, end);
            }
        }
        self.network
    }

    /// Somewhere after its last use.
    fn drop_early(&mut self, agent: usize, end: End) {
        let agent = &mut self.network.agents[agent];
        let is_use = |step: &Step| step.ends().contains(&end);
        let first = agent
            .steps
            .iter()
            .rposition(is_use)
            .map_or(0, |last| last + 1);
        let place = first + self.random.below(agent.steps.len() + 1 - first);
        agent.steps.insert(place, Step::Drop(end));
    }
}
