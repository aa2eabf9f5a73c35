//! Loops of one source file, and the comments that belong to them.

use syn::{
    Expr, ExprAsync, ExprClosure, ExprForLoop, ExprLoop, ExprWhile, ImplItemFn, ItemFn, Signature,
    Stmt, TraitItemFn,
    spanned::Spanned,
    visit::{self, Visit},
};

use super::Lines;
use crate::Count;

/// The statement of a comment.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Stated {
    pub(crate) count: Count,
    /// The function of whose calls one has this total.
    pub(crate) per: Option<String>,
    /// Why it holds.
    pub(crate) reason: Option<String>,
    /// The line of the comment.
    pub(crate) line: u32,
}

/// A loop of the source, or a statement that a comment is above.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct SourceLoop {
    /// `for …`, `while …`, `loop`: up to the brace. Of a statement: all.
    pub(crate) header: Lines,
    pub(crate) whole: Lines,
    /// Whether something is executed in its header each time: not of `loop`.
    pub(crate) has_condition: bool,
    /// Closures and `async` blocks around it, inside its function.
    pub(crate) closures: usize,
    pub(crate) bound: Option<Stated>,
    pub(crate) total: Option<Stated>,
}

/// The loops of a file; or what is wrong, and in which line.
pub(super) fn loops(text: &str) -> Result<Vec<SourceLoop>, (u32, String)> {
    let parsed = syn::parse_file(text).map_err(|error| {
        let line = error.span().start().line as u32;
        (line, error.to_string())
    })?;
    let mut finder = Finder::default();
    finder.visit_file(&parsed);
    let mut loops = finder.loops;
    for comment in comments(text)? {
        attach(&mut loops, &finder.statements, comment)?;
    }
    Ok(loops)
}

/// Whether a comment bounds one entry or a whole activation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Bound,
    Total,
}

struct Comment {
    kind: Kind,
    stated: Stated,
    /// The line of code that it is about.
    target: u32,
}

/// The comments of a file that state bounds.
fn comments(text: &str) -> Result<Vec<Comment>, (u32, String)> {
    let lines: Vec<&str> = text.lines().collect();
    let mut comments = Vec::new();
    for (index, line) in lines.iter().enumerate() {
        let Some((code, comment)) = line.split_once("// wcet-") else {
            continue;
        };
        let number = index as u32 + 1;
        let below = lines[index + 1..].iter().position(|line| is_code(line));
        let target = match below {
            Some(offset) if code.trim().is_empty() => number + 1 + offset as u32,
            _ => number,
        };
        let (comment, reason) = split_reason(comment);
        for part in comment.split(", wcet-") {
            let (kind, value) = if let Some(value) = part.strip_prefix("bound:") {
                (Kind::Bound, value)
            } else if let Some(value) = part.strip_prefix("total:") {
                (Kind::Total, value)
            } else {
                return Err((number, format!("`wcet-{part}` is neither bound nor total")));
            };
            let (value, per) = match value.split_once(" per ") {
                Some((value, per)) if kind == Kind::Total => (value, Some(per.trim().to_owned())),
                _ => (value, None),
            };
            comments.push(Comment {
                kind,
                stated: Stated {
                    count: count(value.trim()).map_err(|error| (number, error))?,
                    per,
                    reason: reason.map(str::to_owned),
                    line: number,
                },
                target,
            });
        }
    }
    Ok(comments)
}

/// The parts of a comment, and the reason behind the last of them.
fn split_reason(comment: &str) -> (&str, Option<&str>) {
    let last = comment.rfind(", wcet-").unwrap_or(0);
    let value = comment[last..].find(':').map_or(last, |at| last + at + 1);
    match comment[value..].trim_start().split_once(": ") {
        Some((_, reason)) => {
            let parts = &comment[..comment.len() - reason.len() - 2];
            (
                parts,
                Some(reason.trim()).filter(|reason| !reason.is_empty()),
            )
        }
        None => (comment, None),
    }
}

fn is_code(line: &str) -> bool {
    let line = line.trim();
    !line.is_empty() && !line.starts_with("//") && !line.starts_with("#[")
}

fn count(value: &str) -> Result<Count, String> {
    if let Ok(number) = value.parse() {
        return Ok(Count::Number(number));
    }
    let is_name = value.starts_with(|letter: char| letter.is_ascii_alphabetic())
        && value
            .chars()
            .all(|letter| letter.is_ascii_alphanumeric() || letter == '_');
    if is_name {
        Ok(Count::Named(value.to_owned()))
    } else {
        Err(format!("`{value}` is neither a number nor a name"))
    }
}

/// Gives `comment` to the loop that begins in its line, else to the statement.
fn attach(
    loops: &mut Vec<SourceLoop>,
    statements: &[(Lines, usize)],
    comment: Comment,
) -> Result<(), (u32, String)> {
    let begins = |lines: &Lines| *lines.start() == comment.target;
    let index = loops.iter().position(|found| begins(&found.whole));
    let index = if let Some(index) = index {
        index
    } else {
        let Some((lines, closures)) = statements.iter().find(|(lines, _)| begins(lines)) else {
            let error = "no loop and no statement begins in the line after this comment";
            return Err((comment.stated.line, error.to_owned()));
        };
        loops.push(SourceLoop {
            header: lines.clone(),
            whole: lines.clone(),
            has_condition: true,
            closures: *closures,
            bound: None,
            total: None,
        });
        loops.len() - 1
    };
    let found = &mut loops[index];
    match comment.kind {
        Kind::Bound => found.bound = Some(comment.stated),
        Kind::Total => found.total = Some(comment.stated),
    }
    Ok(())
}

/// Collects loops and statements.
#[derive(Default)]
struct Finder {
    loops: Vec<SourceLoop>,
    /// Statements and expressions, the outer before the inner, with the closures around them.
    statements: Vec<(Lines, usize)>,
    closures: usize,
}

impl Finder {
    fn add(&mut self, whole: &impl Spanned, body: &syn::Block, has_condition: bool) {
        let whole = lines(whole);
        let brace = body.brace_token.span.open().start().line as u32;
        self.loops.push(SourceLoop {
            header: *whole.start()..=brace,
            whole,
            has_condition,
            closures: self.closures,
            bound: None,
            total: None,
        });
    }

    /// Visits a function: an async one is a closure itself.
    fn function(&mut self, signature: &Signature, visit: impl FnOnce(&mut Self)) {
        self.inside(usize::from(signature.asyncness.is_some()), visit);
    }

    /// Visits what is inside a function, closure or `async` block.
    fn inside(&mut self, closures: usize, visit: impl FnOnce(&mut Self)) {
        let around = std::mem::replace(&mut self.closures, closures);
        visit(self);
        self.closures = around;
    }
}

fn lines(part: &impl Spanned) -> Lines {
    let span = part.span();
    span.start().line as u32..=span.end().line as u32
}

impl<'ast> Visit<'ast> for Finder {
    fn visit_expr_for_loop(&mut self, found: &'ast ExprForLoop) {
        self.add(found, &found.body, true);
        visit::visit_expr_for_loop(self, found);
    }

    fn visit_expr_while(&mut self, found: &'ast ExprWhile) {
        self.add(found, &found.body, true);
        visit::visit_expr_while(self, found);
    }

    fn visit_expr_loop(&mut self, found: &'ast ExprLoop) {
        self.add(found, &found.body, false);
        visit::visit_expr_loop(self, found);
    }

    fn visit_stmt(&mut self, statement: &'ast Stmt) {
        self.statements.push((lines(statement), self.closures));
        visit::visit_stmt(self, statement);
    }

    fn visit_expr(&mut self, expression: &'ast Expr) {
        // A closure's or a match arm's body may be an expression without braces.
        self.statements.push((lines(expression), self.closures));
        visit::visit_expr(self, expression);
    }

    fn visit_item_fn(&mut self, found: &'ast ItemFn) {
        self.function(&found.sig, |finder| visit::visit_item_fn(finder, found));
    }

    fn visit_impl_item_fn(&mut self, found: &'ast ImplItemFn) {
        self.function(&found.sig, |finder| {
            visit::visit_impl_item_fn(finder, found);
        });
    }

    fn visit_trait_item_fn(&mut self, found: &'ast TraitItemFn) {
        self.function(&found.sig, |finder| {
            visit::visit_trait_item_fn(finder, found);
        });
    }

    fn visit_expr_closure(&mut self, closure: &'ast ExprClosure) {
        let closures = self.closures + 1;
        self.inside(closures, |finder| {
            visit::visit_expr_closure(finder, closure);
        });
    }

    fn visit_expr_async(&mut self, block: &'ast ExprAsync) {
        let closures = self.closures + 1;
        self.inside(closures, |finder| visit::visit_expr_async(finder, block));
    }
}
