//! The syntax of CSPm, as far as exported models use it.

/// A file.
#[derive(Debug, Default)]
pub(super) struct Script {
    /// The constructors of each data type.
    pub(super) datatypes: Vec<(String, Vec<String>)>,
    pub(super) channels: Vec<(String, Vec<Expr>)>,
    pub(super) definitions: Vec<Definition>,
    pub(super) assertions: Vec<Assertion>,
}

/// One clause of a definition. Its parameters are variables, or constructors as patterns.
#[derive(Debug)]
pub(super) struct Definition {
    pub(super) name: String,
    pub(super) parameters: Vec<String>,
    pub(super) body: Expr,
}

#[derive(Debug)]
pub(super) enum Assertion {
    DeadlockFree(Expr),
    DivergenceFree(Expr),
    /// The second one has only traces of the first.
    Traces(Expr, Expr),
}

/// Expressions and processes: CSPm has one grammar for both.
#[derive(Debug)]
pub(super) enum Expr {
    Number(i64),
    Name(String),
    Call(String, Vec<Expr>),
    Unary(&'static str, Box<Expr>),
    Binary(&'static str, Box<Expr>, Box<Expr>),
    If(Box<Expr>, Box<Expr>, Box<Expr>),
    Set(Vec<Expr>),
    Range(Box<Expr>, Box<Expr>),
    /// `{| |}`
    Productions(Vec<Expr>),
    Sequence(Vec<Expr>),
    /// `{event | name <- set, ..., condition}`
    Comprehension(Box<Expr>, Vec<(String, Expr)>, Box<Expr>),
    /// `left [| events |] right`
    Interface(Box<Expr>, Box<Expr>, Box<Expr>),
    Dot(Vec<Expr>),
    Prefix(Box<Expr>, Vec<Field>, Box<Expr>),
    /// `|| name : set @ [alphabet] process`
    Parallel {
        name: String,
        set: Box<Expr>,
        alphabet: Box<Expr>,
        process: Box<Expr>,
    },
}

/// What follows a channel in a prefix.
#[derive(Debug)]
pub(super) enum Field {
    Out(Expr),
    /// `_` binds no name.
    In(String, Option<Expr>),
}
