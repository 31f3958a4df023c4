//! `if`, `par` and `choose` in Rust.

use super::body::Body;
use super::expression;
use super::waiting::diverges;
use super::writer::Writer;
use crate::language::body::{Block, StatementKind};
use crate::language::expr::{Expr, Unary};
use crate::language::parser::Path;
use crate::text::Problem;

/// The branches that `par!` takes at most.
const BRANCHES: usize = 12;

impl Body<'_> {
    /// `if`, with what stands before it.
    pub(super) fn conditional(
        &mut self,
        before: &str,
        claim: &Expr<Path>,
        then: &Block,
        otherwise: &Block,
        out: &mut Writer,
    ) -> Result<(), Problem> {
        if then.is_empty() && !otherwise.is_empty() && before.is_empty() {
            let opposite = Expr::Unary(Unary::Not, Box::new(claim.clone()));
            return self.conditional(before, &opposite, otherwise, &Vec::new(), out);
        }
        let mut claims = vec![claim];
        let mut then = then;
        // As Clippy wants it: one `if` for one within another.
        while otherwise.is_empty()
            && let [only] = &then[..]
            && let StatementKind::If(inner, block, none) = &only.kind
            && none.is_empty()
        {
            claims.push(inner);
            then = block;
        }
        for claim in &claims {
            self.note(claim);
        }
        let claim = expression::all_of(&claims, self);
        match before {
            "" => out.open(format!("if {claim} {{")),
            _ => out.turn(&format!("{before}if {claim} {{")),
        }
        self.block(then, out)?;
        if let [only] = &otherwise[..]
            && let StatementKind::If(claim, then, otherwise) = &only.kind
        {
            return self.conditional("} else ", claim, then, otherwise, out);
        }
        if !otherwise.is_empty() {
            out.turn("} else {");
            self.block(otherwise, out)?;
        }
        out.close("}");
        Ok(())
    }

    pub(super) fn par(&mut self, blocks: &[Block], out: &mut Writer) -> Result<(), Problem> {
        self.uses.branch = true;
        out.open("par!(");
        // More than that are groups of branches.
        for group in blocks.chunks(blocks.len().div_ceil(BRANCHES).max(1)) {
            out.open("branch(async {");
            let is_over = match group {
                [only] => {
                    self.block(only, out)?;
                    !diverges(only)
                }
                _ => {
                    self.par(group, out)?;
                    true
                }
            };
            if is_over {
                out.line("Ok(())");
            }
            out.close("}),");
        }
        out.close(")");
        out.line(".await?;");
        Ok(())
    }

    pub(super) fn choose(&mut self, blocks: &[Block], out: &mut Writer) -> Result<(), Problem> {
        if let [only] = blocks {
            return self.block(only, out);
        }
        self.uses.choices += 1;
        let turn = format!("{}.of({})", choice(self.uses.choices), blocks.len());
        if let [first, second] = blocks {
            let (sign, then, otherwise) = match first.is_empty() {
                true => ("!=", second, first),
                false => ("==", first, second),
            };
            // Not within the condition: an `if` around would be merged with it.
            out.line(format!("let chosen = {turn};"));
            out.open(format!("if chosen {sign} 0 {{"));
            self.block(then, out)?;
            if !otherwise.is_empty() {
                out.turn("} else {");
                self.block(otherwise, out)?;
            }
            out.close("}");
            return Ok(());
        }
        out.open(format!("match {turn} {{"));
        for (number, block) in blocks.iter().enumerate() {
            let pattern = match number + 1 == blocks.len() {
                true => "_".to_owned(),
                false => number.to_string(),
            };
            if block.is_empty() {
                out.line(format!("{pattern} => {{}}"));
                continue;
            }
            out.open(format!("{pattern} => {{"));
            self.block(block, out)?;
            out.close("}");
        }
        out.close("}");
        Ok(())
    }
}

/// The counter of a `choose`.
pub(super) fn choice(number: usize) -> String {
    match number {
        1 => "choice".to_owned(),
        _ => format!("choice_{number}"),
    }
}
