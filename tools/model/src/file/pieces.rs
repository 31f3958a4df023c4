//! Values of a model file that are in its own language.

use crate::language::Piece;
use crate::language::expr::Expr;
use crate::language::parser::{Parser, Path};
use crate::text::Problem;
use luna::file::Entry;

/// An entry whose value is read by a parser of this language.
pub(super) trait Pieces<'t> {
    /// A text with its place, for a parser.
    fn piece(&self) -> Result<Piece<'t>, Problem>;

    /// A number, or a text that is an expression.
    fn expr(&self) -> Result<Expr<Path>, Problem>;
}

impl<'t> Pieces<'t> for Entry<'t> {
    fn piece(&self) -> Result<Piece<'t>, Problem> {
        Ok(Piece::new(self.source, self.text()?, self.span()))
    }

    fn expr(&self) -> Result<Expr<Path>, Problem> {
        if self.is_text() {
            return Parser::only_expr(self.piece()?);
        }
        let number = self.number(i32::MIN.into()..=i32::MAX.into())?;
        Ok(Expr::Number(number as i32))
    }
}
