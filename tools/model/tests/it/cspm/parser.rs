//! A parser of CSPm by recursive descent, with the binding strengths of the grammar that FDR uses:
//! `if` and replicated operators bind least, then `\`, `[| |]`, `[]`, `&` and `->`, fields, `.`, `or`,
//! `and`, `not`, comparisons, sums, products, `#`, `^`, and application.

use super::lexer::{Token, tokens};
use super::syntax::{Assertion, Definition, Expr, Field, Script};

/// Words that name nothing.
const KEYWORDS: &str = " and or not if then else let within channel assert datatype subtype \
    nametype external transparent include print module instance exports endmodule ";

pub(super) fn parse(text: &str) -> Script {
    let mut parser = Parser {
        tokens: tokens(text),
        at: 0,
    };
    let mut script = Script::default();
    while parser.take(&Token::Line) {
        parser.definition(&mut script);
    }
    parser.expect(&Token::End);
    script
}

struct Parser {
    tokens: Vec<(Token, usize)>,
    at: usize,
}

impl Parser {
    fn peek(&self) -> &Token {
        &self.tokens[self.at].0
    }

    fn next(&mut self) -> Token {
        self.at += 1;
        self.tokens[self.at - 1].0.clone()
    }

    fn take(&mut self, token: &Token) -> bool {
        let is_it = self.peek() == token;
        self.at += usize::from(is_it);
        is_it
    }

    fn sign(&mut self, sign: &'static str) -> bool {
        self.take(&Token::Sign(sign))
    }

    fn keyword(&mut self, word: &str) -> bool {
        self.take(&Token::Word(word.to_owned()))
    }

    #[track_caller]
    fn expect(&mut self, token: &Token) {
        let (found, line) = &self.tokens[self.at];
        assert_eq!(found, token, "line {line}");
        self.at += 1;
    }

    fn name(&mut self) -> String {
        let line = self.tokens[self.at].1;
        match self.next() {
            Token::Word(word) if !KEYWORDS.contains(&format!(" {word} ")) => word,
            other => panic!("line {line}: {other:?} is no name"),
        }
    }

    /// What is separated by a sign.
    fn list<T>(&mut self, sign: &'static str, one: fn(&mut Self) -> T) -> Vec<T> {
        let mut found = vec![one(self)];
        while self.sign(sign) {
            found.push(one(self));
        }
        found
    }

    fn definition(&mut self, script: &mut Script) {
        if self.keyword("datatype") {
            let name = self.name();
            self.expect(&Token::Sign("="));
            script.datatypes.push((name, self.list("|", Self::name)));
        } else if self.keyword("channel") {
            let names = self.list(",", Self::name);
            let is_typed = self.sign(":");
            // All have the same type: it is read again for each.
            let start = self.at;
            for name in names {
                self.at = start;
                let fields = match is_typed {
                    true => self.list(".", Self::application),
                    false => Vec::new(),
                };
                script.channels.push((name, fields));
            }
        } else if self.keyword("assert") {
            let of = self.process();
            script.assertions.push(self.assertion(of));
        } else {
            let name = self.name();
            let parameters = match self.sign("(") {
                true => {
                    let names = self.list(",", Self::name);
                    self.expect(&Token::Sign(")"));
                    names
                }
                false => Vec::new(),
            };
            self.expect(&Token::Sign("="));
            let body = self.process();
            script.definitions.push(Definition {
                name,
                parameters,
                body,
            });
        }
    }

    fn assertion(&mut self, of: Expr) -> Assertion {
        if self.sign("[T=") {
            return Assertion::Traces(of, self.process());
        }
        self.expect(&Token::Sign(":["));
        let kind = self.name();
        assert!(self.keyword("free"));
        let found = match kind.as_str() {
            "deadlock" => {
                self.expect(&Token::Sign("[F]"));
                Assertion::DeadlockFree(of)
            }
            "divergence" => Assertion::DivergenceFree(of),
            _ => panic!("{kind}"),
        };
        self.expect(&Token::Sign("]"));
        found
    }

    /// `if` and replicated operators reach as far as they can.
    fn process(&mut self) -> Expr {
        self.hiding()
    }

    fn hiding(&mut self) -> Expr {
        let mut left = self.interface();
        while self.sign("\\") {
            left = Expr::Binary("\\", Box::new(left), Box::new(self.interface()));
        }
        left
    }

    fn interface(&mut self) -> Expr {
        let mut left = self.choice();
        while self.sign("[|") {
            let events = Box::new(self.or());
            self.expect(&Token::Sign("|]"));
            left = Expr::Interface(Box::new(left), events, Box::new(self.choice()));
        }
        left
    }

    fn choice(&mut self) -> Expr {
        let mut left = self.prefix();
        while self.sign("[]") {
            left = Expr::Binary("[]", Box::new(left), Box::new(self.prefix()));
        }
        left
    }

    /// `condition & process` and `event -> process`, which bind alike and to the right.
    fn prefix(&mut self) -> Expr {
        if self.keyword("if") {
            let condition = Box::new(self.process());
            assert!(self.keyword("then"));
            let then = Box::new(self.process());
            assert!(self.keyword("else"));
            return Expr::If(condition, then, Box::new(self.process()));
        }
        if self.sign("||") {
            let name = self.name();
            self.expect(&Token::Sign(":"));
            let set = Box::new(self.or());
            self.expect(&Token::Sign("@"));
            self.expect(&Token::Sign("["));
            let alphabet = Box::new(self.or());
            self.expect(&Token::Sign("]"));
            let process = Box::new(self.process());
            return Expr::Parallel {
                name,
                set,
                alphabet,
                process,
            };
        }
        let left = self.dot();
        if self.sign("&") {
            return Expr::Binary("&", Box::new(left), Box::new(self.prefix()));
        }
        let mut fields = Vec::new();
        loop {
            if self.sign("!") {
                fields.push(Field::Out(self.application()));
            } else if self.sign("?") {
                let name = self.name();
                let set = self.sign(":").then(|| self.application());
                fields.push(Field::In(name, set));
            } else {
                break;
            }
        }
        if self.sign("->") {
            return Expr::Prefix(Box::new(left), fields, Box::new(self.prefix()));
        }
        assert!(fields.is_empty(), "{:?}", self.tokens[self.at]);
        left
    }

    /// Binds less than `or`: what stands between dots in exported models is a name each.
    fn dot(&mut self) -> Expr {
        let first = self.or();
        if self.peek() != &Token::Sign(".") {
            return first;
        }
        let mut parts = vec![first];
        while self.sign(".") {
            parts.push(self.or());
        }
        Expr::Dot(parts)
    }

    fn or(&mut self) -> Expr {
        let mut left = self.and();
        while self.keyword("or") {
            left = Expr::Binary("or", Box::new(left), Box::new(self.and()));
        }
        left
    }

    fn and(&mut self) -> Expr {
        let mut left = self.not();
        while self.keyword("and") {
            left = Expr::Binary("and", Box::new(left), Box::new(self.not()));
        }
        left
    }

    fn not(&mut self) -> Expr {
        match self.keyword("not") {
            true => Expr::Unary("not", Box::new(self.not())),
            false => self.comparison(),
        }
    }

    /// Not associative.
    fn comparison(&mut self) -> Expr {
        // `-` takes a whole product: exported models have brackets around what it takes.
        if self.sign("-") {
            return Expr::Unary("-", Box::new(self.binary(1)));
        }
        let left = self.binary(0);
        for sign in ["==", "!=", "<=", ">=", "<", ">"] {
            if self.peek() == &Token::Sign(sign) {
                self.at += 1;
                return Expr::Binary(sign, Box::new(left), Box::new(self.binary(0)));
            }
        }
        left
    }

    fn binary(&mut self, level: usize) -> Expr {
        const LEVELS: [&[&str]; 2] = [&["+", "-"], &["*", "/", "%"]];
        let Some(signs) = LEVELS.get(level) else {
            return self.unary();
        };
        let mut left = self.binary(level + 1);
        while let Some(sign) = signs.iter().find(|sign| self.peek() == &Token::Sign(sign)) {
            self.at += 1;
            left = Expr::Binary(sign, Box::new(left), Box::new(self.binary(level + 1)));
        }
        left
    }

    fn unary(&mut self) -> Expr {
        if self.sign("#") {
            return Expr::Unary("#", Box::new(self.unary()));
        }
        let mut left = self.application();
        while self.sign("^") {
            left = Expr::Binary("^", Box::new(left), Box::new(self.application()));
        }
        left
    }

    /// What stands behind `{event |`: generators, then one condition.
    fn comprehension(&mut self, event: Expr) -> Expr {
        let mut generators = Vec::new();
        loop {
            let start = self.at;
            if matches!(self.next(), Token::Word(_)) && self.sign("<-") {
                self.at = start;
                let name = self.name();
                self.expect(&Token::Sign("<-"));
                generators.push((name, self.or()));
                self.expect(&Token::Sign(","));
                continue;
            }
            self.at = start;
            let condition = Box::new(self.process());
            self.expect(&Token::Sign("}"));
            return Expr::Comprehension(Box::new(event), generators, condition);
        }
    }

    /// What is one thing by its form: a name, a call, a number, or what is in brackets.
    fn application(&mut self) -> Expr {
        let line = self.tokens[self.at].1;
        match self.peek().clone() {
            Token::Number(number) => {
                self.at += 1;
                Expr::Number(number)
            }
            Token::Word(_) => {
                let name = self.name();
                match self.sign("(") {
                    true => {
                        let arguments = self.list(",", Self::process);
                        self.expect(&Token::Sign(")"));
                        Expr::Call(name, arguments)
                    }
                    false => Expr::Name(name),
                }
            }
            Token::Sign(open) => {
                self.at += 1;
                match open {
                    "(" => {
                        let inner = self.process();
                        self.expect(&Token::Sign(")"));
                        inner
                    }
                    "<>" => Expr::Sequence(Vec::new()),
                    "<" => {
                        let items = self.list(",", |parser| parser.binary(0));
                        self.expect(&Token::Sign(">"));
                        Expr::Sequence(items)
                    }
                    "{|" => {
                        let events = self.list(",", Self::dot);
                        self.expect(&Token::Sign("|}"));
                        Expr::Productions(events)
                    }
                    "{" if self.sign("}") => Expr::Set(Vec::new()),
                    "{" => {
                        let first = self.dot();
                        if self.sign("..") {
                            let last = self.or();
                            self.expect(&Token::Sign("}"));
                            return Expr::Range(Box::new(first), Box::new(last));
                        }
                        if self.sign("|") {
                            return self.comprehension(first);
                        }
                        let mut items = vec![first];
                        while self.sign(",") {
                            items.push(self.or());
                        }
                        self.expect(&Token::Sign("}"));
                        Expr::Set(items)
                    }
                    _ => panic!("line {line}: no expression begins with {open}"),
                }
            }
            other => panic!("line {line}: no expression begins with {other:?}"),
        }
    }
}
