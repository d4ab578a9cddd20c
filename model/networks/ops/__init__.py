"""Operations whose gradients are written out, compiled where that pays."""
