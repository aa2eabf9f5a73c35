//! A small map that is copied far more often than it is changed: pairs in the order of their keys.

use std::ops::RangeBounds;

/// See the module.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct SortedMap<K, V>(Vec<(K, V)>);

impl<K: Copy + Ord, V: Copy> SortedMap<K, V> {
    pub(super) const fn new() -> Self {
        Self(Vec::new())
    }

    pub(super) fn get(&self, key: K) -> Option<V> {
        let found = self.0.binary_search_by_key(&key, |pair| pair.0);
        found.ok().map(|at| self.0[at].1)
    }

    pub(super) fn insert(&mut self, key: K, value: V) {
        match self.0.binary_search_by_key(&key, |pair| pair.0) {
            Ok(at) => self.0[at].1 = value,
            Err(at) => self.0.insert(at, (key, value)),
        }
    }

    pub(super) fn values_mut(&mut self) -> impl Iterator<Item = &mut V> {
        self.0.iter_mut().map(|pair| &mut pair.1)
    }

    /// The pairs whose keys are in a range.
    pub(super) fn range(&self, keys: impl RangeBounds<K>) -> impl Iterator<Item = (K, V)> {
        let before = self.0.iter().copied();
        before.filter(move |pair| keys.contains(&pair.0))
    }

    /// Keeps the pairs for which `change` gives a value, with that value.
    pub(super) fn retain(&mut self, mut change: impl FnMut(K, V) -> Option<V>) {
        self.0.retain_mut(|(key, value)| {
            let kept = change(*key, *value);
            kept.inspect(|kept| *value = *kept).is_some()
        });
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// The keys that are in both, with what `join` makes of their values.
    pub(super) fn join(&self, other: &Self, join: impl Fn(V, V) -> Option<V>) -> Self {
        let mut others = other.0.iter().peekable();
        let joined = self.0.iter().filter_map(|&(key, value)| {
            while others.next_if(|other| other.0 < key).is_some() {}
            let other = others.next_if(|other| other.0 == key)?;
            Some((key, join(value, other.1)?))
        });
        Self(joined.collect())
    }
}

impl<K: Ord, V> FromIterator<(K, V)> for SortedMap<K, V> {
    fn from_iter<I: IntoIterator<Item = (K, V)>>(pairs: I) -> Self {
        let mut pairs: Vec<_> = pairs.into_iter().collect();
        pairs.sort_by(|one, other| one.0.cmp(&other.0));
        assert!(pairs.is_sorted_by(|one, other| one.0 < other.0));
        Self(pairs)
    }
}

#[cfg(test)]
mod tests {
    use super::SortedMap;

    #[test]
    fn what_is_in_both_is_joined() {
        let mut one: SortedMap<_, _> = [(5, 'e'), (1, 'a'), (3, 'c')].into_iter().collect();
        one.insert(2, 'b');
        one.insert(3, 'C');
        assert_eq!(one.range(2..5).collect::<Vec<_>>(), [(2, 'b'), (3, 'C')]);
        let other: SortedMap<_, _> = [(0, 'z'), (3, 'C'), (4, 'y'), (5, 'x')]
            .into_iter()
            .collect();
        let same = |value, other| (value == other).then_some(value);
        assert_eq!(one.join(&other, same), [(3, 'C')].into_iter().collect());
        assert_eq!((one.get(5), one.get(4)), (Some('e'), None));
        one.retain(|key, value| (key > 2).then_some(value.to_ascii_uppercase()));
        assert_eq!(one, [(3, 'C'), (5, 'E')].into_iter().collect());
    }
}
