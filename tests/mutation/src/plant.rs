//! Finds the sites of a source file at which a mutant may stand, and writes the mutants beside what they replace.
//!
//! A site is rewritten so that operands are written once: `a + b` becomes
//! `(match (a, b) { (__l, __r) => if is(5) { __l - __r } else { __l + __r } })`.
//! Left out: tests, constants, `const fn`, patterns, types, attributes, and what stands in macros.

use std::collections::BTreeSet;
use std::ops::Range;

use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{BinOp, Expr, Lit, UnOp};

use crate::splice::Splice;

/// A mutant that was planted.
pub struct Mutant {
    /// What `INTERSLICE_MUTANT` calls it.
    pub number: u32,
    /// `file:line:column change`.
    pub key: String,
    /// The bytes of the rewritten file that hold its site.
    pub from: usize,
    /// See `from`.
    pub to: usize,
}

/// A rewritten file.
pub struct Planted {
    pub text: String,
    pub mutants: Vec<Mutant>,
}

/// Rewrites the text of a file with those mutants that are `wanted`, or all; numbers go on from `number`, those of others counted, too.
pub fn plant(file: &str, text: &str, wanted: Option<&BTreeSet<String>>, number: &mut u32) -> syn::Result<Planted> {
    let syntax = syn::parse_file(text)?;
    let mut planter = Planter { file, text, wanted, number, splice: Splice::default(), mutants: Vec::new(), wraps: 0 };
    planter.visit_file(&syntax);
    let Planter { splice, mutants, .. } = planter;
    let (text, held) = splice.finish(text);
    let mutants = mutants
        .into_iter()
        .map(|(number, key, wrap): (u32, String, usize)| {
            let Range { start: from, end: to } = held[wrap].clone();
            Mutant { number, key, from, to }
        })
        .collect();
    Ok(Planted { text, mutants })
}

struct Planter<'t> {
    file: &'t str,
    text: &'t str,
    wanted: Option<&'t BTreeSet<String>>,
    number: &'t mut u32,
    splice: Splice,
    mutants: Vec<(u32, String, usize)>,
    wraps: usize,
}

fn bytes(node: &impl Spanned) -> Range<usize> {
    node.span().byte_range()
}

/// What an arithmetic operator becomes.
fn arithmetic(op: &BinOp) -> &'static [&'static str] {
    match op {
        BinOp::Add(_) => &["-", "*"],
        BinOp::Sub(_) => &["+", "/"],
        BinOp::Mul(_) => &["/", "+"],
        BinOp::Div(_) => &["*"],
        BinOp::Rem(_) => &["/"],
        _ => &[],
    }
}

/// What a comparison becomes.
fn comparison(op: &BinOp) -> &'static [&'static str] {
    match op {
        BinOp::Lt(_) => &["<=", ">"],
        BinOp::Le(_) => &["<", ">"],
        BinOp::Gt(_) => &[">=", "<"],
        BinOp::Ge(_) => &[">", "<"],
        BinOp::Eq(_) => &["!="],
        BinOp::Ne(_) => &["=="],
        _ => &[],
    }
}

/// What an assignment with an operator becomes.
fn assignment(op: &BinOp) -> Option<&'static str> {
    match op {
        BinOp::AddAssign(_) => Some("-="),
        BinOp::SubAssign(_) => Some("+="),
        BinOp::MulAssign(_) => Some("/="),
        BinOp::DivAssign(_) => Some("*="),
        BinOp::BitAndAssign(_) => Some("|="),
        BinOp::BitOrAssign(_) => Some("&="),
        _ => None,
    }
}

/// What a method of a number becomes: of those with one argument, and of those without.
fn method(name: &str, arguments: usize) -> Option<&'static str> {
    match (name, arguments) {
        ("min", 1) => Some("max"),
        ("max", 1) => Some("min"),
        ("floor", 0) => Some("ceil"),
        ("ceil", 0) => Some("floor"),
        ("is_some", 0) => Some("is_none"),
        ("is_none", 0) => Some("is_some"),
        _ => None,
    }
}

/// A doubled literal, or one more where it is an integer.
fn literal(lit: &Lit) -> Option<String> {
    match lit {
        Lit::Int(n) => n.base10_parse::<u64>().ok().map(|value| format!("{}{}", value + 1, n.suffix())),
        Lit::Float(x) => {
            let value = x.base10_parse::<f64>().ok()?;
            Some(format!("{:?}{}", if value == 0.0 { 1.0 } else { 2.0 * value }, x.suffix()))
        }
        Lit::Bool(b) => Some((!b.value).to_string()),
        _ => None,
    }
}

fn has_let(expr: &Expr) -> bool {
    match expr {
        Expr::Let(_) => true,
        Expr::Binary(b) => has_let(&b.left) || has_let(&b.right),
        Expr::Paren(p) => has_let(&p.expr),
        _ => false,
    }
}

fn for_tests(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|a| {
        a.path().is_ident("test") || matches!(&a.meta, syn::Meta::List(l) if l.tokens.to_string().contains("test"))
    })
}

impl Planter<'_> {
    /// The numbers of the mutants of a site that are wanted, each beside its change.
    fn mutants<'c>(
        &mut self,
        at: &impl Spanned,
        change: impl Fn(&str) -> String,
        all: &[&'c str],
    ) -> Vec<(u32, &'c str)> {
        let start = at.span().start();
        let mut kept = Vec::new();
        for new in all {
            *self.number += 1;
            let key = format!("{}:{}:{} {}", self.file, start.line, start.column + 1, change(new));
            if self.wanted.is_none_or(|keys| keys.contains(&key)) {
                self.mutants.push((*self.number, key, self.wraps));
                kept.push((*self.number, *new));
            }
        }
        kept
    }

    fn wrap(&mut self, range: Range<usize>, before: impl Into<String>, after: String) {
        self.splice.wrap(range, before.into(), after);
        self.wraps += 1;
    }

    /// `if is(5) { .. } else if is(6) { .. } else { old }`.
    fn choose(kept: &[(u32, &str)], new: impl Fn(&str) -> String, old: &str) -> String {
        let mut text = String::new();
        for (number, change) in kept {
            text += &format!("if crate::mutation::is({number}) {{ {} }} else ", new(change));
        }
        text + &format!("{{ {old} }}")
    }

    fn binary(&mut self, e: &syn::ExprBinary) {
        let op = self.text[bytes(&e.op)].to_string();
        let shown = |new: &str| format!("{op} -> {new}");
        let (compared, computed) = (comparison(&e.op), arithmetic(&e.op));
        if !compared.is_empty() {
            let kept = self.mutants(&e.op, shown, compared);
            if !kept.is_empty() {
                let after = Self::choose(&kept, |new| format!("*__l {new} *__r"), &format!("*__l {op} *__r"));
                self.wrap(bytes(e), "(match (&(", format!(")) {{ (__l, __r) => {after} }})"));
                self.splice.replace(bytes(&e.op), "), &(".into());
            }
        } else if !computed.is_empty() {
            let kept = self.mutants(&e.op, shown, computed);
            if !kept.is_empty() {
                let after = Self::choose(&kept, |new| format!("__l {new} __r"), &format!("__l {op} __r"));
                self.wrap(bytes(e), "(match (", format!(") {{ (__l, __r) => {after} }})"));
                self.splice.replace(bytes(&e.op), ", ".into());
            }
        } else if let Some(new) = assignment(&e.op) {
            let place = self.text[bytes(&e.left)].to_string();
            if let Some((number, _)) = self.mutants(&e.op, shown, &[new]).first() {
                let (left, right) = (bytes(&e.left), bytes(&e.right));
                let after = format!(
                    " {{ __r => if crate::mutation::is({number}) {{ {place} {new} __r }} else {{ {place} {op} __r }} }}"
                );
                self.wrap(left.start..right.end, "{ ", " }".into());
                self.splice.replace(left.start..right.start, "match ".into());
                self.splice.wrap(right, String::new(), after);
                self.wraps += 1;
            }
            // The place is copied as it stands: nothing in it is mutated.
            self.visit_expr(&e.right);
            return;
        } else if matches!(e.op, BinOp::And(_) | BinOp::Or(_)) && !has_let(&e.left) && !has_let(&e.right) {
            let and = matches!(e.op, BinOp::And(_));
            if let Some((number, _)) = self.mutants(&e.op, shown, &[if and { "||" } else { "&&" }]).first() {
                self.wrap(bytes(e), "(match ", " } else { __l } })".into());
                let equal = if and { "!=" } else { "==" };
                self.splice.replace(bytes(&e.op), format!("{{ __l => if __l {equal} crate::mutation::is({number}) {{"));
            }
        }
        visit::visit_expr_binary(self, e);
    }

    fn unary(&mut self, e: &syn::ExprUnary) {
        let op = match e.op {
            UnOp::Neg(_) => "-",
            UnOp::Not(_) => "!",
            _ => return visit::visit_expr_unary(self, e),
        };
        if let Some((number, _)) = self.mutants(&e.op, |_| format!("{op} left out"), &[""]).first() {
            let after = format!(" {{ __v => if crate::mutation::is({number}) {{ __v }} else {{ {op}__v }} }})");
            self.wrap(bytes(e), "(match ", after);
            self.splice.replace(bytes(&e.op), String::new());
        }
        visit::visit_expr_unary(self, e);
    }

    fn call(&mut self, e: &syn::ExprMethodCall) {
        let name = e.method.to_string();
        if let Some(new) = method(&name, e.args.len()) {
            let kept = self.mutants(&e.method, |new| format!("{name} -> {new}"), &[new]);
            if let Some((number, _)) = kept.first() {
                let argument = e.args.first().map(bytes);
                let (receiver, whole) = (bytes(&e.receiver), bytes(e));
                let (bound, given) = if argument.is_some() { ("(__l, __r)", "__r") } else { ("__l", "") };
                let (open, close) = if argument.is_some() { ("(match (", ")") } else { ("(match ", "") };
                let after = format!(
                    "{close} {{ {bound} => if crate::mutation::is({number}) {{ __l.{new}({given}) }} else {{ __l.{name}({given}) }} }})"
                );
                self.wrap(whole.clone(), open, after);
                match argument {
                    Some(argument) => {
                        self.splice.replace(receiver.end..argument.start, ", ".into());
                        self.splice.replace(argument.end..whole.end, String::new());
                    }
                    None => self.splice.replace(receiver.end..whole.end, String::new()),
                }
            }
        } else if (name == "clamp" && e.args.len() == 2) || (name == "abs" && e.args.is_empty()) {
            let kept = self.mutants(&e.method, |_| format!("{name} left out"), &[""]);
            if let Some((number, _)) = kept.first() {
                let (receiver, whole) = (bytes(&e.receiver), bytes(e));
                let arguments = e.args.first().map(|first| bytes(first).start);
                let (bound, given) = if arguments.is_some() { ("(__v, __l, __h)", "__l, __h") } else { ("(__v,)", "") };
                let after = format!(
                    ") {{ {bound} => if crate::mutation::is({number}) {{ __v }} else {{ __v.{name}({given}) }} }})"
                );
                self.wrap(whole.clone(), "(match (", after);
                let last = e.args.last().map_or(whole.end, |last| bytes(last).end);
                self.splice.replace(receiver.end..arguments.unwrap_or(whole.end), ", ".into());
                if arguments.is_some() {
                    self.splice.replace(last..whole.end, String::new());
                }
            }
        }
        visit::visit_expr_method_call(self, e);
    }
}

impl<'ast> Visit<'ast> for Planter<'_> {
    fn visit_attribute(&mut self, _: &'ast syn::Attribute) {}
    fn visit_item_const(&mut self, _: &'ast syn::ItemConst) {}
    fn visit_item_static(&mut self, _: &'ast syn::ItemStatic) {}
    fn visit_item_enum(&mut self, _: &'ast syn::ItemEnum) {}
    fn visit_impl_item_const(&mut self, _: &'ast syn::ImplItemConst) {}
    fn visit_trait_item_const(&mut self, _: &'ast syn::TraitItemConst) {}
    fn visit_expr_const(&mut self, _: &'ast syn::ExprConst) {}
    fn visit_generic_argument(&mut self, _: &'ast syn::GenericArgument) {}
    fn visit_pat(&mut self, _: &'ast syn::Pat) {}
    fn visit_type(&mut self, _: &'ast syn::Type) {}
    fn visit_macro(&mut self, _: &'ast syn::Macro) {}

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !for_tests(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if item.sig.constness.is_none() && !for_tests(&item.attrs) {
            visit::visit_item_fn(self, item);
        }
    }

    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        if !for_tests(&item.attrs) {
            visit::visit_item_impl(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        if item.sig.constness.is_none() && !for_tests(&item.attrs) {
            visit::visit_impl_item_fn(self, item);
        }
    }

    fn visit_expr_repeat(&mut self, e: &'ast syn::ExprRepeat) {
        self.visit_expr(&e.expr);
    }

    fn visit_expr_if(&mut self, e: &'ast syn::ExprIf) {
        // A comparison has mutants of its own.
        if !has_let(&e.cond) && !matches!(&*e.cond, Expr::Binary(_) | Expr::Unary(_)) {
            let kept = self.mutants(&e.cond, |_| "if -> if not".into(), &[""]);
            if let Some((number, _)) = kept.first() {
                self.wrap(bytes(&e.cond), format!("(crate::mutation::is({number}) != ("), "))".into());
            }
        }
        visit::visit_expr_if(self, e);
    }

    fn visit_stmt(&mut self, statement: &'ast syn::Stmt) {
        if let syn::Stmt::Expr(
            e @ (Expr::Call(_) | Expr::MethodCall(_) | Expr::Continue(_) | Expr::Assign(_)),
            Some(_),
        ) = statement
        {
            let what = match e {
                Expr::Continue(_) => "continue left out",
                Expr::Assign(_) => "assignment left out",
                _ => "call left out",
            };
            if let Some((number, _)) = self.mutants(e, |_| what.into(), &[""]).first() {
                self.wrap(bytes(e), format!("if !crate::mutation::is({number}) {{ "), "; }".into());
            }
        }
        visit::visit_stmt(self, statement);
    }

    fn visit_expr(&mut self, e: &'ast Expr) {
        match e {
            Expr::Binary(e) => self.binary(e),
            Expr::Unary(e) => self.unary(e),
            Expr::MethodCall(e) => self.call(e),
            Expr::Lit(e) => {
                let Some(new) = literal(&e.lit) else { return };
                let old = self.text[bytes(e)].to_string();
                if let Some((number, _)) = self.mutants(e, |new| format!("{old} -> {new}"), &[&new]).first() {
                    let after = format!(" }} else {{ {old} }})");
                    self.wrap(bytes(e), format!("(if crate::mutation::is({number}) {{ "), after);
                    self.splice.replace(bytes(e), new);
                }
            }
            _ => visit::visit_expr(self, e),
        }
    }
}
